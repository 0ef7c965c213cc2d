"""The table of commands, read both ways."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.errors import BaudError, UsageError
from realitygap.robots.epuck import EPUCK
from realitygap.robots.khepera import KHEPERA
from realitygap.robots.line import GarbledError, Protocol, RefusedError, Request, answer, step_budget

ASCII = st.characters(min_codepoint=32, max_codepoint=126)
DIALECTS = pytest.mark.parametrize("protocol", [KHEPERA, EPUCK], ids=lambda protocol: protocol.robot)


def requests(protocol: Protocol) -> st.SearchStrategy[Request]:
    """Any command that the robot takes."""

    def of(letter: str) -> st.SearchStrategy[Request]:
        takes = [st.integers(span.low, span.high) for span in protocol.commands[letter].takes]
        return st.tuples(*takes).map(lambda arguments: Request(letter, arguments))

    return st.sampled_from(sorted(protocol.commands)).flatmap(of)


@DIALECTS
@given(data=st.data())
def test_a_command_reads_back_as_it_was_written(protocol: Protocol, data: st.DataObject) -> None:
    """What the driver writes is what the robot reads."""
    asked = data.draw(requests(protocol))
    assert protocol.request(asked.letter, *asked.arguments) == asked
    assert protocol.parse_request(asked.data.decode()) == asked


@DIALECTS
@given(data=st.data())
def test_an_answer_reads_back_as_it_was_written(protocol: Protocol, data: st.DataObject) -> None:
    """What the robot answers is what the driver reads."""
    asked = data.draw(requests(protocol))
    form = protocol.commands[asked.letter]
    values = tuple(data.draw(st.integers(span.low, span.high)) for span in form.gives)
    if form.text is not None:
        values = tuple(data.draw(st.from_regex(form.text, fullmatch=True, alphabet=ASCII)) for _ in values)
    said = answer(asked.letter, *values).decode().strip("\r\n")
    assert protocol.parse_answer(said, asked) == values


@DIALECTS
@given(text=st.text(max_size=20))
def test_any_text_is_a_command_or_refused_in_the_robots_words(protocol: Protocol, text: str) -> None:
    """Nothing that comes down the line breaks the robot."""
    try:
        asked = protocol.parse_request(text)
    except RefusedError as refusal:
        assert str(refusal) in (protocol.not_found, protocol.protocol_error)
    else:
        assert asked.letter in protocol.commands


@DIALECTS
@given(text=st.text(max_size=30))
def test_any_text_is_an_answer_or_an_error(protocol: Protocol, text: str) -> None:
    """Nothing that comes back breaks the driver."""
    try:
        values = protocol.parse_answer(text, Request("N"))
    except (GarbledError, RefusedError):
        return
    assert len(values) == 8


@pytest.mark.parametrize("line", ["D,128,0", "D,0", "D,1,2,3", "D", "D,x,0", "N,1", "I,6", "L,2,0", "D,5 5"])
def test_wrong_arguments_are_a_protocol_error(line: str) -> None:
    """Too many, too few, out of range or no numbers."""
    with pytest.raises(RefusedError, match="z,Protocol error"):
        KHEPERA.parse_request(line)


@pytest.mark.parametrize("line", ["Q", "d,1,1", "hello", "DD,1,1", "+"])
def test_an_unknown_text_is_not_found(line: str) -> None:
    """A text that begins with no command's letter and comma."""
    with pytest.raises(RefusedError, match="Command not found"):
        KHEPERA.parse_request(line)


@pytest.mark.parametrize(
    "line", ["n,1,2,3", "n,1,2,3,4,5,6,7,1024", "o,1,2,3,4,5,6,7,8", "n,1,2,3,4,5,6,7,x"]
)
def test_a_wrong_answer_is_garbled(line: str) -> None:
    """Too few values, values that no converter gives, another command's answer."""
    with pytest.raises(GarbledError):
        KHEPERA.parse_answer(line, Request("N"))


def test_a_refused_command_names_what_it_takes() -> None:
    """The driver refuses before the robot does."""
    with pytest.raises(UsageError, match=r"command D .* takes -127\.\.127, -127\.\.127; got \[200, 0\]"):
        KHEPERA.request("D", 200, 0)
    with pytest.raises(UsageError, match="no command 'Q'"):
        KHEPERA.request("Q")


def test_the_longest_answers_are_as_long_as_the_table_says() -> None:
    """Times on the wire are worst cases."""
    asked = Request("N")
    assert KHEPERA.characters(asked) == len(asked.data) + len(answer("N", *[1023] * 8))
    asked = Request("E")
    assert KHEPERA.characters(asked) >= len(asked.data) + len(answer("E", -127, -127))
    assert KHEPERA.wire_ms(384, 38400) == pytest.approx(110.0)


def test_9600_baud_is_refused_for_both_kinds_of_sensors() -> None:
    """N + O + D are 103 characters of 11 bits: 118 ms of a step of 100 ms."""
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
