"""The table of commands, read both ways."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.errors import BaudError
from realitygap.robots.epuck import EPUCK
from realitygap.robots.khepera import KHEPERA
from realitygap.robots.line import GarbledError, Protocol, RefusedError, Request, answer, step_budget

ASCII = st.characters(min_codepoint=32, max_codepoint=126)
PROTOCOLS = pytest.mark.parametrize("protocol", [KHEPERA, EPUCK], ids=lambda protocol: protocol.robot)


def requests(protocol: Protocol) -> st.SearchStrategy[Request]:
    """Any command that the robot takes."""

    def of(letter: str) -> st.SearchStrategy[Request]:
        takes = [st.integers(span.low, span.high) for span in protocol.commands[letter].takes]
        return st.tuples(*takes).map(lambda arguments: Request(letter, arguments))

    return st.sampled_from(sorted(protocol.commands)).flatmap(of)


@PROTOCOLS
@given(data=st.data())
def test_commands_and_answers_read_back_as_they_were_written(protocol: Protocol, data: st.DataObject) -> None:
    """What the driver writes is what the robot reads, and the other way round."""
    asked = data.draw(requests(protocol))
    assert protocol.request(asked.letter, *asked.arguments) == asked
    assert protocol.parse_request(asked.data.decode()) == asked
    form = protocol.commands[asked.letter]
    values = tuple(data.draw(st.integers(span.low, span.high)) for span in form.gives)
    if form.text is not None:
        values = tuple(data.draw(st.from_regex(form.text, fullmatch=True, alphabet=ASCII)) for _ in values)
    said = answer(asked.letter, *values).decode().strip("\r\n")
    assert protocol.parse_answer(said, asked) == values


@PROTOCOLS
@given(text=st.text(max_size=30))
def test_any_text_is_understood_or_refused(protocol: Protocol, text: str) -> None:
    """Nothing that comes down the line breaks the robot, nothing that comes back the driver."""
    try:
        asked = protocol.parse_request(text)
    except RefusedError as refusal:
        assert str(refusal) in (protocol.not_found, protocol.protocol_error)
    else:
        assert asked.letter in protocol.commands
    try:
        values = protocol.parse_answer(text, Request("N"))
    except (GarbledError, RefusedError):
        return
    assert len(values) == 8


def test_the_longest_answers_are_as_long_as_the_table_says() -> None:
    """Times on the wire are worst cases."""
    asked = Request("N")
    assert KHEPERA.characters(asked) == len(asked.data) + len(answer("N", *[1023] * 8))
    assert KHEPERA.wire_ms(384, 38400) == pytest.approx(110.0)
    with pytest.raises(BaudError, match=r"103 × 11 / 9600 s = 118 ms; set the robot to 19200 baud or more"):
        step_budget(KHEPERA, ("proximity", "ambient"), 9600)


@pytest.mark.parametrize(
    ("kinds", "baud", "reads"),
    [
        (("proximity",), 9600, "NH"),
        (("ambient",), 9600, "OH"),
        (("proximity", "ambient"), 19200, "NOHE"),
        (("ambient", "proximity"), 38400, "NOHE"),
        (("proximity",), 115200, "NHE"),
        ((), 38400, "H"),
    ],
)
def test_a_step_carries_what_fits(kinds: tuple[str, ...], baud: int, reads: str) -> None:
    """Sensors first, then counters, then speeds, within 100 ms; without sensors the counters alone."""
    budget = step_budget(KHEPERA, kinds, baud)
    assert "".join(read.letter for read in budget.reads) == reads
    assert budget.ms <= 100
