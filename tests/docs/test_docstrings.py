"""Docstrings begin as a reader of Python expects."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
DIALECT = {"Give", "Gives", "Say", "Says", "Tell", "Tells", "Let", "Lets", "Have", "Take"}


def test_no_docstring_begins_in_dialect():
    found = []
    for file in sorted(ROOT.glob("[a-z]*/**/*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                words = (ast.get_docstring(node, clean=False) or "").split(maxsplit=1)
                if words and words[0] in DIALECT:
                    found.append(f"{file.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}: {words[0]}")
    assert not found
