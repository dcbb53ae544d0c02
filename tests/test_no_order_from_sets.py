"""No iteration over a set decides an order: that of strings differs from one process to the next (PYTHONHASHSEED)."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [
    path
    for package in ("inkjet_env", "optimizers", "experiments")
    for path in sorted((ROOT / package).rglob("*.py"))
    if "concealed_rig" not in path.parts
]
ORDERED = {"sorted", "set", "frozenset", "len", "any", "all", "min", "max", "bool", "isinstance"}
"""What gives the same whatever order it is given, ``min`` and ``max`` without a key."""
IN_ORDER = {"list", "tuple", "enumerate", "iter", "zip", "map", "filter", "fromkeys", "join", "sum", "array", "fsum",
            "extend", "chain", "concatenate"}  # fmt: skip
MADE = {"set", "frozenset"}
METHODS = {"union", "intersection", "difference", "symmetric_difference"}
NUMBERS = {"condition", "order"}
"""Attributes that are whole numbers, whose order in a set no seed changes."""


def name_of(node):
    """The last name of what is called, or of an attribute."""
    if isinstance(node, ast.Subscript):
        node = node.value
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", None)


class Sets:
    """Which expressions of a source are sets, from how names are assigned and annotated in it."""

    def __init__(self, tree):
        self.names = {}
        self.scopes = {}
        self.attributes, self.functions = set(), set()
        self._walk(tree, (tree,))

    def _walk(self, node, scope):
        self.scopes[node] = scope
        for child in ast.iter_child_nodes(node):
            inner = scope
            if isinstance(child, ast.FunctionDef):
                inner = (*scope, child)
                if name_of(child.returns) in MADE:
                    held = self.attributes if any(name_of(d) in ("property", "cached_property") for d in
                                                  child.decorator_list) else self.functions  # fmt: skip
                    held.add(child.name)
                for argument in (*child.args.args, *child.args.kwonlyargs):
                    if name_of(argument.annotation) in MADE:
                        self.names.setdefault(child, set()).add(argument.arg)
            elif isinstance(child, ast.Lambda):
                inner = (*scope, child)
            elif isinstance(child, ast.AnnAssign) and name_of(child.annotation) in MADE:
                self._noted(child.target, scope)
            self._walk(child, inner)
            if isinstance(child, ast.Assign) and self.is_set(child.value):
                for target in child.targets:
                    self._noted(target, scope)
            if isinstance(child, ast.Assign) and isinstance(child.value, ast.Tuple):
                for target in child.targets:
                    for part, value in zip(getattr(target, "elts", ()), child.value.elts, strict=False):
                        if self.is_set(value):
                            self._noted(part, scope)

    def _noted(self, target, scope):
        if isinstance(target, ast.Attribute):
            self.attributes.add(target.attr)
        elif isinstance(target, ast.Name):
            self.names.setdefault(scope[-1], set()).add(target.id)
            if isinstance(scope[-1], ast.Module):
                self.attributes.add(target.id)

    def is_set(self, node):
        """Whether an expression is a set, of anything but numbers."""
        if isinstance(node, ast.Set):
            return not all(isinstance(e, ast.Constant) and isinstance(e.value, (int, float)) for e in node.elts)
        if isinstance(node, ast.SetComp):
            return not (isinstance(node.elt, ast.Attribute) and node.elt.attr in NUMBERS)
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute) and node.func.attr in METHODS:
                return self.is_set(node.func.value)
            return name_of(node.func) in MADE | self.functions
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.BitOr, ast.BitAnd, ast.Sub, ast.BitXor)):
            sides = (node.left, node.right)
            return any(self.is_set(s) or (isinstance(s, ast.Call) and name_of(s.func) == "keys") for s in sides)
        if isinstance(node, ast.BoolOp):
            return any(map(self.is_set, node.values))
        if isinstance(node, ast.IfExp):
            return self.is_set(node.body) or self.is_set(node.orelse)
        if isinstance(node, ast.Name):
            return any(node.id in self.names.get(scope, ()) for scope in self.scopes.get(node, ()))
        return isinstance(node, ast.Attribute) and node.attr in self.attributes


def iterated(source):
    """Lines on which the order of a set decides something."""
    tree = ast.parse(source)
    sets, lines, harmless = Sets(tree), [], set()
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and name_of(node.func) in ORDERED
            and not any(k.arg == "key" for k in node.keywords)
        ):
            harmless.update(argument for argument in node.args if isinstance(argument, ast.GeneratorExp))
        if isinstance(node, ast.Set):
            harmless.update(node.elts)
    for node in ast.walk(tree):
        if isinstance(node, ast.For):
            over = [node.iter]
        elif isinstance(node, (ast.ListComp, ast.GeneratorExp, ast.DictComp)) and node not in harmless:
            over = [generator.iter for generator in node.generators]
        elif (isinstance(node, ast.Starred) and node not in harmless) or isinstance(node, ast.FormattedValue):
            over = [node.value]
        elif isinstance(node, ast.Call) and name_of(node.func) == "pop" and not node.args:
            over = [node.func.value]
        elif isinstance(node, ast.Call) and (
            name_of(node.func) in IN_ORDER
            or (name_of(node.func) in ("min", "max", "sorted") and any(k.arg == "key" for k in node.keywords))
        ):
            over = node.args
        else:
            continue
        if any(map(sets.is_set, over)):
            lines.append(node.lineno)
    return sorted(set(lines))


@pytest.mark.parametrize(
    "source",
    [
        "for x in {a.b for a in c}: pass",
        "for x in {a.b for a in c} - set(d): pass",
        "def f(c):\n    s = {a.b for a in c}\n    return [x for x in s]",
        "def f(s: set[str]):\n    return tuple(s)",
        "def f(c) -> set[str]:\n    return set(c)\ndef g(c):\n    return ', '.join(f(c))",
        "x = {n: 1 for n in a.keys() - b}",
        "x = list({'a', 'b'} | c)",
        "class A:\n    s: frozenset[str]\n    def f(self):\n        return [*self.s]",
        "x = sum(d[k] for k in {a.b for a in c})",
        "x = max(set(a), key=len)",
        "x = f'{set(a)}'",
        "for x in set(a) if a else b: pass",
        "x = sorted(set(a), key=len)",
    ],
)
def test_what_takes_its_order_from_a_set_is_seen(source):
    assert iterated(source)


@pytest.mark.parametrize(
    "source",
    [
        "for x in sorted({a.b for a in c}): pass",
        "x = {y for y in {a.b for a in c}}",
        "x = any(y for y in {a.b for a in c})",
        "x = max(len(y) for y in set(a))",
        "for x in dict.fromkeys(a): pass",
        "for x in {a.condition for a in c}: pass",
        "def f(c):\n    s = set(c)\n    return len(s), 'a' in s\ndef g(s):\n    return [x for x in s]",
        "for x in {1, 2}: pass",
    ],
)
def test_what_does_not_is_let_through(source):
    assert iterated(source) == []


def test_no_order_comes_from_a_set():
    found = [f"{path.relative_to(ROOT)}:{line}" for path in FILES for line in iterated(path.read_text())]
    assert found == []
