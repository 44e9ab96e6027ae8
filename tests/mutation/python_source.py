# SPDX-License-Identifier: MIT
"""Mutants of Python source: one small change of the syntax tree each.

Operators and comparisons are exchanged, conditions negated, integers moved by one, ``and`` and ``or`` swapped, ``min`` and
``max``, ``any`` and ``all`` too, statements that do something dropped. Left alone are texts (of messages and of C, which
`tests.mutation.c_source` changes where the C is printed), annotations, decorators, docstrings, and what type checkers alone
read: none of them decides what is computed.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

_BINARY: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
}
_COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_CALLS = {"min": "max", "max": "min", "any": "all", "all": "any"}


@dataclass(frozen=True)
class Mutant:
    """One change: where it is, and the expression or statement before and after it."""

    path: str
    function: str
    """The dotted name of the function or class that it is in; empty at the top of the module."""
    line: int
    before: str
    after: str
    number: int
    """Its place among the file's mutants."""
    span: tuple[int, int]
    """The first and last line of its statement, without the blocks of it."""

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What names it in the list of survivors, wherever its line moves to."""
        return (self.path, self.function, self.before, self.after)


@dataclass(frozen=True)
class _Change:
    function: str
    line: int
    shown: ast.AST
    """The expression or statement that is printed before and after."""
    apply: Callable[[], None]
    undo: Callable[[], None]
    dropped: bool = False
    span: tuple[int, int] = (0, 0)


def mutants(path: str, source: str) -> list[Mutant]:
    """All mutants of a module, in a fixed order."""
    found = []
    for number, change in enumerate(_changes(ast.parse(source))):
        before = _text(change.shown)
        change.apply()
        after = "pass" if change.dropped else _text(change.shown)
        change.undo()
        found.append(Mutant(path, change.function, change.line, before, after, number, change.span))
    return found


def mutated(source: str, number: int) -> str:
    """The module's source with mutant ``number`` in it; comments are lost, line numbers move."""
    tree = ast.parse(source)
    for at, change in enumerate(_changes(tree)):
        if at == number:
            change.apply()
            return ast.unparse(ast.fix_missing_locations(tree))
    raise IndexError(number)


def _text(node: ast.AST) -> str:
    text = ast.unparse(node)
    return text if len(text) <= 160 else text[:157] + "..."


def _changes(tree: ast.Module) -> Iterator[_Change]:
    yield from _body(tree, "")


def _body(parent: ast.AST, function: str) -> Iterator[_Change]:
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        block = getattr(parent, field, None)
        if not isinstance(block, list):
            continue
        for index, statement in enumerate(block):
            inner = getattr(statement, "body", None)
            first = getattr(statement, "lineno", 0)
            last = inner[0].lineno - 1 if isinstance(inner, list) else getattr(statement, "end_lineno", first)
            for change in _statement(block, index, statement, function):
                # The innermost statement has set it already.
                yield change if change.span != (0, 0) else replace(change, span=(first, max(first, last)))


def _statement(block: list[ast.AST], index: int, statement: ast.AST, function: str) -> Iterator[_Change]:
    match statement:
        case ast.FunctionDef() | ast.ClassDef():
            inner = f"{function}.{statement.name}".lstrip(".")
            if isinstance(statement, ast.FunctionDef):
                defaults = [*statement.args.defaults, *(d for d in statement.args.kw_defaults if d is not None)]
                for default in defaults:
                    yield from _expressions(default, inner)
            yield from _body(statement, inner)
            return
        case ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.Import() | ast.ImportFrom() | ast.Assert() | ast.Raise():
            return
        case ast.If(test=ast.Compare(left=ast.Name(id="__name__"))):
            return
        case ast.Expr(value=ast.Constant()):
            return  # a docstring
        case ast.Expr() | ast.AugAssign() | ast.Continue() | ast.Break() | ast.Delete():
            yield _dropped(block, index, statement, function)
        case ast.If() | ast.While():
            yield _negated(statement, function)
    yield from _expressions(statement, function)
    yield from _body(statement, function)


def _dropped(block: list[ast.AST], index: int, statement: ast.AST, function: str) -> _Change:
    def put(node: ast.AST) -> Callable[[], None]:
        return lambda: block.__setitem__(index, node)

    line = getattr(statement, "lineno", 0)
    return _Change(function, line, statement, put(ast.Pass()), put(statement), dropped=True)


def _negated(statement: ast.If | ast.While | ast.IfExp, function: str) -> _Change:
    test = statement.test

    def put(node: ast.expr) -> Callable[[], None]:
        return lambda: setattr(statement, "test", node)

    shown = ast.Expression(test)

    def apply() -> None:
        negation = ast.UnaryOp(ast.Not(), test)
        shown.body = negation
        statement.test = negation

    def undo() -> None:
        shown.body = test
        put(test)()

    return _Change(function, test.lineno, shown, apply, undo)


def _expressions(root: ast.AST, function: str) -> Iterator[_Change]:
    """Changes of the expressions of one statement, blocks of it excepted."""
    yield from _expression(root, root, function)


def _expression(node: ast.AST, shown: ast.AST, function: str) -> Iterator[_Change]:
    line = getattr(node, "lineno", 0)

    def swap(target: ast.AST, field: str, new: object, show: ast.AST) -> _Change:
        old = getattr(target, field)
        return _Change(function, line, show, lambda: setattr(target, field, new), lambda: setattr(target, field, old))

    def replace_item(items: list[ast.cmpop], at: int, new: ast.cmpop, show: ast.AST) -> _Change:
        old = items[at]
        return _Change(function, line, show, lambda: items.__setitem__(at, new), lambda: items.__setitem__(at, old))

    match node:
        case ast.BinOp() | ast.AugAssign() if type(node.op) in _BINARY and not _is_text(node):
            yield swap(node, "op", _BINARY[type(node.op)](), node)
        case ast.Compare():
            for at, operator in enumerate(node.ops):
                for other in _COMPARE[type(operator)]:
                    yield replace_item(node.ops, at, other(), node)
        case ast.BoolOp():
            yield swap(node, "op", ast.Or() if isinstance(node.op, ast.And) else ast.And(), node)
        case ast.UnaryOp(op=ast.USub() | ast.Invert()):
            yield swap(node, "op", ast.UAdd(), node)
        case ast.IfExp():
            yield _negated(node, function)
        case ast.Constant(value=bool()):
            yield swap(node, "value", not node.value, shown)
        case ast.Constant(value=int()):
            yield swap(node, "value", node.value + 1, shown)
        case ast.Constant(value=float()):
            yield swap(node, "value", node.value + max(abs(node.value), 1) / 16, shown)
        case ast.Call(func=ast.Name() as called) if called.id in _CALLS:
            yield swap(called, "id", _CALLS[called.id], node)
    for field, value in ast.iter_fields(node):
        if field in ("body", "orelse", "finalbody", "handlers", "cases") and isinstance(value, list):
            continue
        if isinstance(value, ast.expr) and isinstance(node, ast.keyword) and node.arg == "strict":
            continue  # of zip: it raises where the code contradicts itself
        if field in ("annotation", "returns", "type_comment", "decorator_list", "format_spec"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                here = child if not isinstance(child, (ast.Constant, ast.operator, ast.expr_context)) else node
                yield from _expression(
                    child, here if isinstance(here, (ast.expr, ast.stmt, ast.pattern)) else shown, function
                )


def _is_text(node: ast.BinOp | ast.AugAssign) -> bool:
    """Whether an operator joins or repeats texts, where another would be a type error and nothing else."""
    sides = [node.value] if isinstance(node, ast.AugAssign) else [node.left, node.right]
    return any(
        isinstance(side, ast.JoinedStr) or (isinstance(side, ast.Constant) and isinstance(side.value, (str, bytes)))
        for side in sides
    )
