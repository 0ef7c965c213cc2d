"""The words of a command line before they are read: numbers with commas, options given twice."""

from collections import Counter

import click

__all__ = ["tidy"]


def tidy(command: click.Command, ctx: click.Context, args: list[str]) -> list[str]:
    """The words after a command's name; "25,25,90" becomes three where an option takes three.

    Args:
        command: whose words they are; of a group's, the subcommand's are looked at too.
        ctx: the group's that holds it.
        args: the words.

    Raises:
        click.UsageError: an option that takes one value and is given twice, or too few numbers.
    """
    own = click.Context(command, info_name=command.name, parent=ctx)
    options = [p for p in command.get_params(own) if isinstance(p, click.Option)]
    for option in options:
        if option.nargs > 1:
            args = _apart(option, own, args)
    try:
        _, rest, order = command.make_parser(own).parse_args(list(args))
    except click.UsageError:
        return args  # click's own words, when it reads them
    for param, times in Counter(p for p in order if isinstance(p, click.Option)).items():
        if times > 1 and not (param.multiple or param.is_flag or param.count):
            raise click.UsageError(f"{param.opts[0]}: expected once, got {times} times. Give it once.", own)
    inner = command.get_command(own, rest[0]) if isinstance(command, click.Group) and rest else None
    if inner is None:
        return args
    before = args[: len(args) - len(rest) + 1]
    return [*before, *tidy(inner, own, rest[1:])]


def _apart(option: click.Option, ctx: click.Context, args: list[str]) -> list[str]:
    """Numbers with commas between them, after an option that takes several, as words of their own."""
    made: list[str] = []
    words = list(args)
    while words:
        word = words.pop(0)
        name, sign, joined = word.partition("=")
        if name not in option.opts:
            made.append(word)
            continue
        numbers = joined.split(",") if sign else []
        while words and len(numbers) < option.nargs and not words[0].startswith("--"):
            numbers += [number for number in words.pop(0).split(",") if number]
        if len(numbers) != option.nargs:
            expected = f"{option.nargs} numbers, {option.metavar}, such as {name} 25 25 90"
            raise click.UsageError(f"{name}: expected {expected}, got {' '.join(numbers) or 'none'}.", ctx)
        made += [name, *numbers]
    return made
