"""The text form of a genotype: exact, readable, and clear about what is wrong with it."""

from __future__ import annotations

import difflib
import os

import numpy as np
import pytest
from hypothesis import given

from realitygap.control.genotype import (
    Layout,
    constant,
    from_text,
    load_genotype,
    parse_text,
    save_genotype,
    to_text,
)
from realitygap.control.network import NetworkController
from realitygap.control.operators import Variation, random_genotype
from realitygap.errors import GenotypeError, UsageError
from realitygap.values import Command
from tests.controller.strategies import SMALL, genotypes

TEXT = """\
realitygap genotype 1
layout inputs 8 outputs 2 slots 30 links 8

slot 8 threshold -3  # left motor
  link 0 from 2 weight 4 delay 0
  link 3 from 14 weight -2 delay 1  # dormant
slot 9 threshold 0  # right motor
slot 12 threshold 0  # hidden
slot 13 off threshold 5  # hidden
  link 7 off from 0 weight 0 delay 4
end
"""


@given(genotypes())
def test_round_trip(genes):
    """Text and back is the same genotype, unexpressed and dormant content included."""
    text = to_text(genes, SMALL)
    back, layout = parse_text(text)
    assert back.dtype == np.int8 and (back == genes).all() and layout == SMALL
    assert to_text(back, layout) == text


def test_the_text_is_what_the_docs_show():
    """A text form reads as documented, and writing what was read gives the same text."""
    genes = from_text(TEXT)
    assert genes[8, 1] == -3 and genes[8, 2:6].tolist() == [1, 2, 4, 0]
    assert genes[8, 14:18].tolist() == [1, 14, -2, 1] and genes[14, 0] == 0
    assert genes[12, 0] == 1 and genes[13].any() and genes[13, 0] == 0
    assert to_text(genes) == TEXT


def test_a_change_is_a_line():
    """One changed weight changes one line: genotypes can be compared by diff."""
    genes = from_text(TEXT)
    genes[8, 4] = -4
    changed = [
        line for line in difflib.ndiff(TEXT.splitlines(), to_text(genes).splitlines()) if line[0] in "+-"
    ]
    assert changed == ["-   link 0 from 2 weight 4 delay 0", "+   link 0 from 2 weight -4 delay 0"]


def test_comments_and_spacing_are_free():
    """Comments, blank lines, indentation and line ends do not matter."""
    loose = "# mine\r\n" + TEXT.replace("\n", "   # so\r\n\r\n").replace(" threshold", "\t threshold")
    assert (from_text(loose) == from_text(TEXT)).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("realitygap genotype 1", "realitygap genotype 2", 'line 1: expected "realitygap genotype 1", got'),
        ("outputs 2", "outputs 3", "line 2: layout.outputs: expected 2"),
        ("slots 30", "slots 9", "line 2: layout.slots: expected 10"),
        ("layout inputs", "inputs", 'line 2: expected "layout inputs N'),
        ("threshold -3", "threshold -11", "line 4: expected a threshold of -10 to 10, got"),
        ("slot 8 threshold", "slot 8 off threshold", "line 4: expected slot 8 .left motor. without off"),
        ("slot 8 threshold", "slot 30 threshold", "line 4: expected a slot of 0 to 29"),
        ("slot 8 threshold -3", "slot eight", 'line 4: expected "slot N'),
        ("weight 4", "weight 5", "line 5: expected a weight of -4 to 4, got"),
        ("weight 4", "weight 4.0", 'line 5: expected "link N'),
        ("delay 1", "delay 5", "line 6: expected a delay of 0 to 4"),
        ("delay 1", "delay -1", 'line 6: expected "link N'),
        ("from 14", "from 30", "line 6: expected a source slot of 0 to 29"),
        ("link 3", "link 0", "line 6: expected link 0 only once in slot 8"),
        ("link 3", "link 8", "line 6: expected a link field of 0 to 7"),
        ("slot 12", "slot 8", "line 8: expected slot 8 only once"),
        ("slot 12", "neuron 12", 'line 8: expected "slot …", "link …" or "end"'),
        ("slot 8 threshold -3", "", 'line 5: expected "slot …"'),
        ("end\n", "", "line 11: expected .*, got the end of the text"),
        ("end\n", "end\nend\n", 'line 12: expected nothing after "end"'),
        (TEXT, "", "line 1: expected .*, got the end of the text"),
        (TEXT, "\x00", "line 1: expected"),
        ("weight 4", "weight " + "9" * 5000, "line 5"),
    ],
)
def test_mistakes_are_named_by_line(old, new, message):
    """A text that cannot be read is refused with its source, line, what was expected and what came."""
    with pytest.raises(GenotypeError, match="mine.txt, " + message):
        from_text(TEXT.replace(old, new, 1), "mine.txt")


def test_every_truncation_is_refused():
    """A text that was cut off anywhere is never taken for a smaller network."""
    for cut in range(len(TEXT.rstrip())):
        with pytest.raises(GenotypeError, match="line"):
            from_text(TEXT[:cut])


def test_files(tmp_path):
    """A genotype saved is the genotype loaded."""
    genes = random_genotype(Layout(), np.uint64(3))
    save_genotype(tmp_path / "a.genotype", genes)
    assert (load_genotype(tmp_path / "a.genotype", Layout()) == genes).all()
    assert b"\r" not in (tmp_path / "a.genotype").read_bytes()


def test_other_inputs_are_not_taken_for_eight():
    """Without its layout a genotype of more inputs is refused, not read as one whose wheels stand."""
    wide = Layout(inputs=16)
    genes = constant(1, 2, wide)
    for use in (to_text, NetworkController):
        with pytest.raises(GenotypeError, match=r"of 8 inputs, .* slots 8 and 9 are blank.*Give its layout"):
            use(genes)
    assert (parse_text(to_text(genes, wide))[0] == genes).all()
    assert NetworkController(constant(0, 0, Layout())).decide([0] * 8) == Command(left=0, right=0)


def test_files_that_cannot_be_read_or_written(tmp_path):
    """A missing file, a folder, bytes that are no text, and other inputs are refused by name."""
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    save_genotype(tmp_path / "three", random_genotype(SMALL, np.uint64(1)), SMALL)
    for name, message in (
        ("missing", "cannot read the genotype .*missing: No such file"),
        ("", "cannot read the genotype .*: Is a directory"),
        ("bytes", "not a text in UTF-8"),
        ("three", "expected a genotype of 8 inputs, got 3"),
    ):
        with pytest.raises(GenotypeError, match=message):
            load_genotype(os.path.join(tmp_path, name), Layout())
    with pytest.raises(UsageError, match="layout: expected a Layout, got str"):
        load_genotype(tmp_path / "three", "x")
    with pytest.raises(GenotypeError, match="cannot write the genotype"):
        save_genotype(tmp_path / "no" / "where", random_genotype(Layout(), np.uint64(1)))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ((12, 0), 2, "slot 12: an expressed flag: expected 0 to 1, got 2"),
        ((8, 1), 11, "slot 8: a threshold: expected -10 to 10, got 11"),
        ((8, 3), 30, "slot 8: a link's source slot: expected 0 to 29, got 30"),
        ((8, 3), -1, "source slot: expected 0 to 29, got -1"),
        ((8, 4), -5, "weight: expected -4 to 4, got -5"),
        ((29, 5), 5, "slot 29: a link's delay: expected 0 to 4, got 5"),
        ((9, 0), 0, "slot 9 .right motor. must always be expressed"),
    ],
)
def test_genes_out_of_range_are_refused(place, value, message):
    """An array with a value out of its range is refused by slot and field."""
    genes = from_text(TEXT)
    genes[place] = value
    with pytest.raises(GenotypeError, match=message):
        to_text(genes)


def test_rates_of_a_random_genotype():
    """A random genotype is the variation's, with the same rates."""
    genes = random_genotype(Layout(), np.uint64(5), start_neurons=0.5)
    assert (genes == Variation(start_neurons=0.5).random(np.uint64(5))).all()
