# SPDX-License-Identifier: MIT
"""Reads pickles without Python's unpickler: a small machine that knows the opcodes of plain data and no others.

A pickle is a program, and Python's machine can be made to run code, to overflow the C stack with nested tuples, or to hash
for hours. This one builds lists, dictionaries and scalars only, bounds their number and nesting while it builds them, and lets
only what cannot hold anything else be used twice or as a key.
"""

from __future__ import annotations

import pickletools
from collections.abc import Callable, Mapping
from typing import Any

from bitneat.errors import BitneatError

MAX_DEPTH = 24
MAX_OPCODES = 3_000_000

_SCALARS = frozenset("BININT BININT1 BININT2 LONG1 BINFLOAT SHORT_BINUNICODE BINUNICODE NONE NEWTRUE NEWFALSE".split())
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_MEMO_WRITES = frozenset(("MEMOIZE", "BINPUT", "LONG_BINPUT"))
_MEMO_READS = frozenset(("BINGET", "LONG_BINGET"))
_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_ONE_ITEM = {"APPEND": 1, "SETITEM": 2}
_CONTAINERS = frozenset(("EMPTY_LIST", "EMPTY_DICT", "MARK", "TUPLE", "APPENDS", "SETITEMS", *_TUPLES, *_ONE_ITEM))
_OBJECTS = frozenset(("GLOBAL", "STACK_GLOBAL", "NEWOBJ", "BUILD"))
_NOTHING = frozenset(("PROTO", "FRAME"))


class UnpickleError(BitneatError):
    """A pickle is damaged, or asks for more than plain data."""


class Record:
    """Stands in for an object of a class that the caller knows: its attributes and no behaviour."""


class _Class:
    """A class that the pickle names: what `NEWOBJ` makes."""

    def __init__(self, make: Callable[[], Record]) -> None:
        self.make = make


def read(content: bytes, classes: Mapping[tuple[str, str], Callable[[], Record]] | None = None) -> Any:
    """The data in a pickle; tuples come out as lists, except pairs of integers among objects, which may be keys.

    Args:
        content: the pickle.
        classes: what stands in for the objects of the classes of these modules and names; without it objects are refused.

    Raises:
        BitneatError: if it is damaged, uses any other opcode or class, or is too deep or too long.
    """
    try:
        return _Machine(classes).run(content)
    except BitneatError:
        raise
    except Exception as error:  # a damaged pickle can make pickletools raise nearly anything
        raise UnpickleError(f"a damaged or truncated pickle ({type(error).__name__})") from None


class _Machine:
    def __init__(self, classes: Mapping[tuple[str, str], Callable[[], Record]] | None) -> None:
        self.classes = classes
        self.stack: list[Any] = []
        self.below: list[list[Any]] = []
        self.memo: dict[int, Any] = {}
        # Levels in each container. One that was put into another is off the stack and cannot be had from the memo, so that it
        # never changes again; all of them stay alive here, which keeps their ids apart.
        self.levels: dict[int, tuple[int, Any]] = {}

    def run(self, content: bytes) -> Any:
        for number, (opcode, argument, _) in enumerate(pickletools.genops(content)):
            if number >= MAX_OPCODES:
                raise UnpickleError(f"refused: more than {MAX_OPCODES} operations")
            name = opcode.name
            if name in _SCALARS:
                self.stack.append(_CONSTANTS.get(name, argument))
            elif name == "STOP":
                return self.stack.pop()
            elif name not in _NOTHING:
                self.carry_out(name, argument)
        raise UnpickleError("a damaged or truncated pickle (it has no end)")

    def carry_out(self, name: str, argument: Any) -> None:
        stack = self.stack
        if name in _CONTAINERS:
            self.fill_container(name)
        elif name in _MEMO_WRITES:
            self.memo[len(self.memo) if argument is None else argument] = stack[-1]
        elif name in _MEMO_READS:
            value = self.memo[argument]
            if not isinstance(value, (str, tuple, _Class)):
                raise UnpickleError(f"refused: a {type(value).__name__} that is used twice")
            stack.append(value)
        elif self.classes is not None and name in _OBJECTS:
            self.make_object(name, argument)
        else:
            detail = f" ({argument!r:.60})" if isinstance(argument, str) else ""
            raise UnpickleError(
                f"refused: the pickle uses {name}{detail}, which plain data does not need and can run code"
            )

    def fill_container(self, name: str) -> None:
        stack = self.stack
        if name == "EMPTY_LIST":
            self.push([])
        elif name == "EMPTY_DICT":
            self.push({})
        elif name == "MARK":
            if len(self.below) > MAX_DEPTH:
                raise UnpickleError(f"refused: more than {MAX_DEPTH} levels")
            self.below.append(stack)
            self.stack = []
        elif name in _TUPLES:
            self.push_tuple(self.top(_TUPLES[name]))
        elif name == "TUPLE":
            self.push_tuple(self.above_mark())
        else:
            values = self.top(_ONE_ITEM[name]) if name in _ONE_ITEM else self.above_mark()
            put = self.extend if name.startswith("APPEND") else self.update
            put(self.stack[-1], values)

    def make_object(self, name: str, argument: Any) -> None:
        assert self.classes is not None
        stack = self.stack
        if name == "BUILD":
            state, target = stack.pop(), stack[-1]
            if isinstance(state, list) and len(state) == 2 and state[0] is None:
                state = state[1]  # of a class with __slots__
            if not isinstance(target, Record) or not isinstance(state, dict):
                raise UnpickleError("refused: the state of an object is no dictionary")
            if not all(type(key) is str for key in state):
                raise UnpickleError("refused: a key is not a string")
            self.enclose(target, [state])
            vars(target).update(state)
        elif name == "NEWOBJ":
            arguments, made = stack.pop(), stack.pop()
            if not isinstance(made, _Class) or arguments != []:
                raise UnpickleError("refused: an object is made with arguments")
            self.push(made.make())
        else:
            if name == "GLOBAL":
                module, _, attribute = argument.partition(" ")
            else:
                attribute, module = stack.pop(), stack.pop()
            make = None
            if isinstance(module, str) and isinstance(attribute, str):
                make = self.classes.get((module, attribute))
            if make is None:
                known = ", ".join(sorted(name for _, name in self.classes))
                raise UnpickleError(
                    f"refused: the pickle names {module!s:.60}.{attribute!s:.60}; only {known} are read"
                )
            stack.append(_Class(make))

    def push(self, container: Any) -> None:
        self.levels[id(container)] = (1, container)
        self.stack.append(container)

    def push_tuple(self, values: list[Any]) -> None:
        if self.classes is not None and len(values) == 2 and all(type(value) is int for value in values):
            self.stack.append(tuple(values))
            return
        self.push([])
        self.extend(self.stack[-1], values)

    def top(self, size: int) -> list[Any]:
        if size > len(self.stack):
            raise UnpickleError("a damaged pickle (it takes what is not there)")
        start = len(self.stack) - size
        values = self.stack[start:]
        del self.stack[start:]
        return values

    def above_mark(self) -> list[Any]:
        values, self.stack = self.stack, self.below.pop()
        return values

    def extend(self, target: Any, values: list[Any]) -> None:
        if not isinstance(target, list):
            raise UnpickleError("a damaged pickle (it appends to what is no list)")
        self.enclose(target, values)
        target.extend(values)

    def update(self, target: Any, values: list[Any]) -> None:
        if not isinstance(target, dict) or len(values) % 2:
            raise UnpickleError("a damaged pickle (it sets an item of what is no dictionary)")
        self.enclose(target, values)
        for key, value in zip(values[::2], values[1::2], strict=True):
            # Only the keys of objects' own dictionaries are anything else.
            if not (isinstance(key, str) or (self.classes is not None and type(key) in (int, tuple))):
                raise UnpickleError("refused: a key is not a string")
            target[key] = value

    def enclose(self, target: Any, values: list[Any]) -> None:
        inner = max(
            (self.levels[id(value)][0] for value in values if isinstance(value, (list, dict, Record))), default=0
        )
        levels = max(self.levels[id(target)][0], inner + 1)
        if levels > MAX_DEPTH:
            raise UnpickleError(f"refused: more than {MAX_DEPTH} levels")
        self.levels[id(target)] = (levels, target)
