"""Large tuples by a pointer: a call then hands on one value, not the hundreds that a World is made of.

A kernel's way in lays them down in its frame, and whatever it calls reads a field there where it needs it.
Nobody writes there meanwhile, which LLVM is told: so a loop knows its length as if the tuple were its own.
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
"""Fields up to which a tuple is handed on by its values, unless one of them is a large tuple."""
_MANY = ir.LiteralStructType | ir.ArrayType


class Pointed(types.Type):
    """A tuple of a type, where it lies."""

    def __init__(self, dtype):
        self.dtype = dtype
        # A short name, for it is in the name of each function that is told one.
        super().__init__(f"Pointed.{hashlib.sha256(str(dtype).encode()).hexdigest()[:16]}")


def met(kind):
    """The type as which kernels meet what has a type outside."""
    named = isinstance(kind, types.NamedTuple | types.NamedUniTuple)
    large = named and (len(kind) > SMALL or any(isinstance(met(one), Pointed) for one in kind))
    return Pointed(kind) if large else kind


@register_model(Pointed)
class _Model(models.PointerModel):  # type: ignore[misc]
    def from_argument(self, builder, value):
        """Where it may be read at any time, what a loop asks at each turn is read once before it."""
        value.attributes.dereferenceable = 8 * _count(value.type.pointee)
        return value


def _count(kind):
    """Of the numbers of eight bytes in a tuple or an array."""
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
    """A field's value; of one that is a large tuple, where it lies."""
    at = kind.dtype.fields.index(name)
    there, field = cgutils.gep_inbounds(builder, value, 0, at), met(kind.dtype[at])
    found = there if isinstance(field, Pointed) else _read(builder, there)
    return impl_ret_borrowed(context, builder, field, found)


def _read(builder, there):
    """All that lies there, number by number."""
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
    """The same tuple, and of the tuples in it the large ones by a pointer."""
    kinds = types.Tuple([met(kind) for kind in given])

    def lay_down(context, builder, signature, arguments):
        values = [builder.extract_value(arguments[0], i) for i in range(len(kinds))]
        for i, kind in enumerate(kinds):
            if isinstance(kind, Pointed):
                values[i] = cgutils.alloca_once_value(builder, values[i])
        return context.make_tuple(builder, kinds, values)

    return kinds(given), lay_down
