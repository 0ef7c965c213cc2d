"""What the site looks like, and what is made of its pages beside them."""

from __future__ import annotations

import re
from collections.abc import Container
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

import realitygap
from realitygap.report import style
from realitygap.report.drawing import arena_figure, robot_figure
from realitygap.tasks.task import Task
from realitygap.world.robot import Profile

REPORT = Path(realitygap.__file__).parent / "report" / "templates" / "page.css"
FURO = {
    "color-foreground-primary": "ink",
    "color-foreground-secondary": "muted",
    "color-foreground-muted": "muted",
    "color-foreground-border": "line",
    "color-background-primary": "page",
    "color-background-secondary": "page",
    "color-background-hover": "own",
    "color-background-border": "line",
    "color-background-item": "line",
    "color-sidebar-background": "page",
    "color-sidebar-search-background": "paper",
    "color-sidebar-search-background--focus": "paper",
    "color-sidebar-link-text--top-level": "ink",
    "color-sidebar-caption-text": "muted",
    "color-toc-background": "page",
    "color-card-background": "paper",
    "color-card-border": "line",
    "color-admonition-background": "paper",
    "color-api-background": "own",
    "color-api-background-hover": "own",
    "color-api-name": "link",
    "color-api-pre-name": "muted",
    "color-api-overall": "muted",
    "color-inline-code-background": "own",
    "color-code-background": "paper",
    "color-code-foreground": "ink",
    "color-brand-primary": "link",
    "color-brand-content": "link",
    "color-brand-visited": "link",
    "color-link": "link",
    "color-link--visited": "link",
    "color-link-underline": "grid",
    "font-stack": "serif",
    "font-stack--headings": "serif",
}
"""The theme's variables, and the report's that they take."""


def colours() -> dict[str, dict[str, str]]:
    """The report's variables in light and dark, with the theme's that follow them."""
    text = REPORT.read_text("utf-8")
    light = re.search(r":root \{(.*?)\}", text, re.DOTALL)
    dark = re.search(r"\{% set dark %\}(.*?)\{% endset %\}", text, re.DOTALL)
    assert light and dark
    found = {
        f"{name}_css_variables": dict(re.findall(r"--([\w-]+): ([^;]+);", block[1]))
        for name, block in (("light", light), ("dark", dark))
    }
    assert set(FURO.values()) <= set(found["light_css_variables"])
    for name, value in FURO.items():
        found["light_css_variables"][name] = f"var(--{value})"
    found["dark_css_variables"] |= {
        name: f"var(--{value})" for name, value in FURO.items() if name.startswith("color")
    }
    return found


def pictured(text: str) -> str:
    """A page's text with drawings of tasks and robots in the places of `<!-- picture NAME -->`."""

    def drawn(found: re.Match[str]) -> str:
        return f'{found[1]}<div class="picture">{_drawing(found[2])}</div>\n\n{" " * len(found[1])}'

    return re.sub(r"(?m)^(- )<!-- picture (\S+) -->\s*", drawn, text)


def _drawing(name: str) -> str:
    """A task's arena or a robot, in the page's colours, in one line."""
    examples = Path(__file__).parent.parent / "examples"
    own = examples / name
    with style.styled():
        if name in ("obstacle-avoidance", "light-seeking") or own.suffix == ".py":
            task: Task = realitygap.load_task(own if own.suffix else name)
            robot = realitygap.load_profile("paper")
            figure = arena_figure(task.arena, robot, task.feeds, task.to_kernel(robot).start)
            alt = f"The arena of {task.title.lower()} from above, with the robot and its sensors' rays"
            figure.axes[0].set_axis_off()
        else:
            profile: Profile = realitygap.load_profile(own if own.suffix else name)
            figure = robot_figure(profile)
            alt = "The robot from above, with its sensors and its size"
        svg = style.inline_svg(style.save_figure(figure, None, name), re.sub(r"\W", "-", name), alt)
    return re.sub(r"\s*\n\s*", " ", svg)


def downloads(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document) -> None:
    """Links above a notebook's page: to the notebook as it ran, and to its cells as a program."""
    name = page.removeprefix("tutorial/")
    if name != page:
        context["body"] = (
            f'<p class="take">Take it away: <a href="{name}.ipynb" download>notebook with its output</a> '
            f'(Jupyter, VS Code), <a href="{name}.py" download>its cells as a program</a>; '
            f'<a href="../notebooks.html#in-colab">in Colab</a></p>{context["body"]}'
        )


def notebooks(app: Sphinx) -> None:
    """Beside each notebook's page the notebook as it ran, with its output, and its text."""
    ran = Path(app.outdir).parent / "jupyter_execute" / "tutorial"
    for text in Path(app.srcdir, "tutorial").glob("*.py"):
        for file in (text, ran / f"{text.stem}.ipynb"):
            Path(app.outdir, "tutorial", file.name).write_bytes(file.read_bytes())


def write_llms(app: Sphinx, shown: Container[str]) -> None:
    """`llms.txt` (llmstxt.org): what the project is, and each guide with its first sentences.

    `shown` are pages that only show a file from elsewhere.
    """
    env, lines = app.env, [f"# {app.config.project}", ""]
    front = env.get_doctree("index")
    lines += [f"> {_first(front)}", "", f"In Python: `import realitygap`; version {app.config.release}."]
    for toctree in front.findall(lambda node: node.tagname == "toctree"):
        lines += ["", f"## {toctree['caption']}", ""]
        for title, page in toctree["entries"]:
            name = title or env.titles[page].astext()
            text = env.doc2path(page, base=False)
            made = page in shown or page.startswith("reference/")  # its text is not in its source
            lines.append(f"- [{name}]({page}.html)" if made else f"- [{name}](_sources/{text}.txt)")
            first = _first(env.get_doctree(page))
            lines[-1] += f": {first}" if first else ""
    Path(app.outdir, "llms.txt").write_text("\n".join(lines) + "\n", "utf-8")


def _first(tree: nodes.document) -> str:
    """A page's first paragraph of prose."""
    texts = (
        node.astext() for node in tree.findall(nodes.paragraph) if isinstance(node.parent, nodes.section)
    )
    text = next((" ".join(text.split()) for text in texts if len(text) > 40), "")
    return re.sub(r"<[^>]+>", "", text).removesuffix(":")
