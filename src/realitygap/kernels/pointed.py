"""Large tuples passed by pointer: a call then passes one value, not the hundreds in a World.

A kernel's entry stores them in its stack frame, and the functions that it calls read fields from there.
LLVM is told that nobody writes to them meanwhile, so it can move such reads out of loops.
"""

# mypy: allow-untyped-defs, no-check-untyped-defs
import hashlib

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model

__all__ = ["met", "pointed"]

SMALL = 6
"""Tuples with at most this many fields are passed by value, unless a field is a large tuple itself."""
_MANY = ir.LiteralStructType | ir.ArrayType


class Pointed(types.Type):
    """A pointer to a tuple of type `dtype`."""

    def __init__(self, dtype):
        self.dtype = dtype
        # A short name, because it is part of the name of each function that takes one.
        super().__init__(f"Pointed.{hashlib.sha256(str(dtype).encode()).hexdigest()[:16]}")


def met(kind):
    """The type that a kernel's inside uses for a value of type `kind`."""
    named = isinstance(kind, types.NamedTuple | types.NamedUniTuple)
    large = named and (len(kind) > SMALL or any(isinstance(met(one), Pointed) for one in kind))
    return Pointed(kind) if large else kind


@register_model(Pointed)
class _Model(models.PointerModel):  # type: ignore[misc]
    def from_argument(self, builder, value):
        """Mark the memory as always readable, so that LLVM may read it once, before a loop."""
        value.attributes.dereferenceable = 8 * _count(value.type.pointee)
        return value


def _count(kind):
    """Number of eight-byte numbers in a tuple or an array."""
    if not isinstance(kind, _MANY):
        return 1
    return sum(_count(kind.gep(ir.IntType(32)(i))) for i in range(len(kind)))


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = Pointed

    def generic_resolve(self, kind, name):
        fields = kind.dtype.fields
        return met(kind.dtype[fields.index(name)]) if name in fields else None


@lower_getattr_generic(Pointed)
def _field(context, builder, kind, value, name):
    """A field's value, or a pointer to it if it is a large tuple."""
    at = kind.dtype.fields.index(name)
    there, field = cgutils.gep_inbounds(builder, value, 0, at), met(kind.dtype[at])
    found = there if isinstance(field, Pointed) else _read(builder, there)
    return impl_ret_borrowed(context, builder, field, found)


def _read(builder, there):
    """The value at a pointer, loaded number by number."""
    kind = there.type.pointee
    if not isinstance(kind, _MANY):
        value = builder.load(there)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    whole = ir.Constant(kind, ir.Undefined)
    for i in range(len(kind)):
        whole = builder.insert_value(whole, _read(builder, cgutils.gep_inbounds(builder, there, 0, i)), i)
    return whole


@intrinsic
def pointed(typingctx, given):
    """The same tuple, with the large tuples in it replaced by pointers."""
    kinds = types.Tuple([met(kind) for kind in given])

    def lay_down(context, builder, signature, arguments):
        values = [builder.extract_value(arguments[0], i) for i in range(len(kinds))]
        for i, kind in enumerate(kinds):
            if isinstance(kind, Pointed):
                values[i] = cgutils.alloca_once_value(builder, values[i])
        return context.make_tuple(builder, kinds, values)

    return kinds(given), lay_down
