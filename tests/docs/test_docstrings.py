"""Docstrings begin as a reader of Python expects, and describe the arguments that a function has."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
DIALECT = {"Give", "Gives", "Say", "Says", "Tell", "Tells", "Let", "Lets", "Have", "Take"}

#: FastAPI and typer describe the arguments of routes and commands to those who use them; the rest is not called from
#: other packages.
ELSEWHERE = re.compile(r"^(tests|benchmarks|docs|api/routes|rotorid/cli)/|/migrations/|_kernels\.py$|_decode\.py$")

#: A section up to the next heading, of a cleaned docstring.
PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?=^\S[^\n]*\n-{3,}$|\Z)", re.MULTILINE | re.DOTALL)

Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_functions(node: ast.AST, within: str = "") -> Iterator[tuple[str, Function]]:
    """Yield functions and methods that have no underscore in front, nor has the class they are of."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, Function | ast.ClassDef):
            if child.name.startswith("_"):
                continue
            if isinstance(child, Function):
                yield within + child.name, child
            else:
                yield from public_functions(child, f"{within}{child.name}.")
        elif not isinstance(child, ast.expr):
            yield from public_functions(child, within)


def undescribed(function: Function) -> str:
    """Compare the arguments of a function with its section Parameters; empty where it has less than three."""
    if "overload" in map(ast.unparse, function.decorator_list):
        return ""
    own = function.args
    arguments = [each.arg for each in (*own.posonlyargs, *own.args, *own.kwonlyargs) if each.arg not in ("self", "cls")]
    if len(arguments) < 3:
        return ""
    arguments += [each.arg for each in (own.vararg, own.kwarg) if each is not None]
    section = PARAMETERS.search(ast.get_docstring(function) or "")
    if section is None:
        return "no Parameters"
    lines = [line for line in section[1].splitlines() if line and not line[0].isspace()]
    described = [name.strip().lstrip("*") for line in lines for name in line.partition(" :")[0].split(",")]
    return "" if sorted(described) == sorted(arguments) else f"describes {described}, has {arguments}"


def test_no_docstring_begins_in_dialect():
    found = []
    for file in sorted(ROOT.glob("[a-z]*/**/*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                words = (ast.get_docstring(node, clean=False) or "").split(maxsplit=1)
                if words and words[0] in DIALECT:
                    found.append(f"{file.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}: {words[0]}")
    assert not found


def test_every_public_function_of_three_arguments_or_more_describes_each():
    found = []
    for file in sorted(ROOT.glob("[a-z]*/**/*.py")):
        place = file.relative_to(ROOT).as_posix()
        if not ELSEWHERE.search(place):
            for name, function in public_functions(ast.parse(file.read_text(encoding="utf-8"))):
                if wrong := undescribed(function):
                    found.append(f"{place}:{function.lineno}: {name}: {wrong}")
    assert not found


def test_a_wrong_description_is_found():
    """So that the test above cannot pass by looking past what it should find."""
    head = 'def f(a, b, *c, d, **e):\n    """Do.\n\n    Parameters\n    ----------\n'

    def wrong(names: str) -> str:
        tree = ast.parse(f'{head}    {names} : int\n        1.\n\n    Raises\n    ------\n    OSError\n    """\n')
        return undescribed(next(public_functions(tree))[1])

    assert wrong("a, b, *c, d, **e") == wrong("a, b, c, d, e") == ""
    assert all(map(wrong, ("a, b, d", "a, b, c, d, e, x", "a, a, b, c, d, e")))
