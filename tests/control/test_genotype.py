"""The text form of a genotype: exact, readable, and clear about what is wrong with it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from realitygap.control.genotype import Genotype
from realitygap.errors import GenotypeError
from tests.control.strategies import SMALL, genotypes

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
    genotype = Genotype(genes, SMALL.inputs)
    back = Genotype.parse(str(genotype))
    assert back == genotype and back.genes.dtype == np.int8 and str(back) == str(genotype)
    assert (back.inputs, back.slots, back.links) == (SMALL.inputs, SMALL.slots, SMALL.links)


def test_the_text_is_what_the_docs_show():
    """A text form reads as documented, and writing what was read gives the same text."""
    genes = Genotype.parse(TEXT).genes
    assert genes[8, 1] == -3 and genes[8, 2:6].tolist() == [1, 2, 4, 0]
    assert genes[8, 14:18].tolist() == [1, 14, -2, 1] and genes[14, 0] == 0
    assert genes[12, 0] == 1 and genes[13].any() and genes[13, 0] == 0
    assert str(Genotype.parse(TEXT)) == TEXT


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "realitygap genotype 1",
            "realitygap genotype 2",
            ': expected lines from "realitygap gen',
        ),
        ("outputs 2", "outputs 3", ', line 2: expected "layout inputs N'),
        ("slots 30", "slots 9", ", line 2: expected inputs, links, and inputs . 2 to 128 slots"),
        ("threshold -3", "threshold -11", ", line 4: expected a threshold of -10 to 10, got"),
        ("slot 8 threshold", "slot 8 off threshold", ", line 4: expected off only beyond the motors"),
        ("slot 8 threshold", "slot 30 threshold", ", line 4: expected a slot of 0 to 29"),
        ("weight 4", "weight 5", ", line 5: expected a weight of -4 to 4, got"),
        ("weight 4", "weight 4.0", ', line 5: expected "link N'),
        ("delay 1", "delay 5", ", line 6: expected a delay of 0 to 4"),
        ("from 14", "from 30", ", line 6: expected a source slot of 0 to 29"),
        ("link 3", "link 0", ", line 6: expected a link of 0 to 7, and each once"),
        ("slot 12", "slot 8", ", line 8: expected a slot of 0 to 29, and each once"),
        ("slot 12", "neuron 12", ', line 8: expected "slot N'),
        ("slot 8 threshold -3", "", ', line 5: expected "slot N'),
        ("end\n", "end\nend\n", ', line 11: expected "slot N'),
        ("weight 4", "weight " + "9" * 5000, ", line 5"),
    ],
)
def test_mistakes_are_named_by_line(old, new, message):
    """A text that cannot be read is refused with its source, line, what was expected and what came."""
    with pytest.raises(GenotypeError, match="mine.txt" + message):
        Genotype.parse(TEXT.replace(old, new, 1), "mine.txt")


def test_every_truncation_is_refused():
    """A text that was cut off anywhere is never taken for a smaller network."""
    for cut in range(len(TEXT.rstrip())):
        with pytest.raises(GenotypeError, match="genotype"):
            Genotype.parse(TEXT[:cut])


def test_files(tmp_path):
    """A genotype saved is the genotype loaded."""
    genotype = Genotype.random(3)
    genotype.save(tmp_path / "a.genotype")
    assert Genotype.load(tmp_path / "a.genotype", 8) == genotype
    assert b"\r" not in (tmp_path / "a.genotype").read_bytes()


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ((12, 0), 2, "slot 12, expressed: expected 0 to 1, got 2"),
        ((8, 1), 11, "slot 8, threshold: expected -10 to 10, got 11"),
        ((8, 3), 30, "slot 8, link 0, source slot: expected 0 to 29, got 30"),
        ((8, 4), -5, "weight: expected -4 to 4, got -5"),
        ((29, 5), 5, "slot 29, link 0, delay: expected 0 to 4, got 5"),
        ((9, 0), 0, "slot 9, expressed: expected 1 to 1, got 0"),
    ],
)
def test_genes_out_of_range_are_refused(place, value, message):
    """An array with a value out of its range is refused by slot and field."""
    genes = Genotype.parse(TEXT).genes.copy()
    genes[place] = value
    with pytest.raises(GenotypeError, match=message):
        Genotype(genes, 8)
