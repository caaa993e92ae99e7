"""Mutants of the exercises' solutions: each is the solution with one small fault in it."""

import ast
import copy
import re
from collections.abc import Iterator
from pathlib import Path

SCRIPTS = Path(__file__).parents[2] / "notebooks" / "scripts" / "exercises"

SWAPPED = {
    **{ast.Add: [ast.Sub], ast.Sub: [ast.Add], ast.Mult: [ast.Div, ast.Add], ast.Div: [ast.Mult]},
    **{ast.FloorDiv: [ast.Mult, ast.Div], ast.Mod: [ast.FloorDiv], ast.Pow: [ast.Mult]},
    **{ast.BitAnd: [ast.BitOr], ast.BitOr: [ast.BitAnd], ast.BitXor: [ast.BitAnd]},
    **{ast.Lt: [ast.LtE, ast.Gt], ast.LtE: [ast.Lt, ast.GtE], ast.Gt: [ast.GtE, ast.Lt]},
    **{ast.GtE: [ast.Gt, ast.LtE], ast.Eq: [ast.NotEq], ast.NotEq: [ast.Eq]},
    **{ast.In: [ast.NotIn], ast.Is: [ast.IsNot], ast.IsNot: [ast.Is]},
    **{ast.And: [ast.Or], ast.Or: [ast.And]},
}
NAMES = {
    **{"min": ["max"], "max": ["min", "mean"], "any": ["all"], "all": ["any"], "sum": ["max"]},
    **{"argmax": ["argmin"], "amax": ["amin"], "mean": ["sum", "max"], "std": ["var"]},
    **{"log2": ["log", "log10"], "sqrt": ["abs"], "abs": ["float"], "normal": ["uniform"]},
    **{"no_fly": ["buildings"], "landing": ["no_fly"], "where": ["minimum"]},
}
UNWRAPPED = {"abs", "sqrt", "int", "float"}


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    """Other nodes that could stand in this one's place."""

    def changed(**fields):
        other = copy.copy(node)
        for name, value in fields.items():
            setattr(other, name, value)
        return other

    match node:
        case (
            ast.BinOp(left=left, op=op, right=right)
            | ast.AugAssign(target=left, op=op, value=right)
        ):
            for kind in SWAPPED.get(type(op), []):
                yield changed(op=kind())
            if isinstance(node, ast.BinOp):
                yield left
                yield right
                if not isinstance(op, ast.Add | ast.Mult | ast.BitAnd | ast.BitOr):
                    yield changed(left=right, right=left)
        case ast.BoolOp(op=op, values=values):
            yield changed(op=SWAPPED[type(op)][0]())
            for k in range(len(values)):
                rest = values[:k] + values[k + 1 :]
                yield rest[0] if len(rest) == 1 else changed(values=rest)
        case ast.Compare(ops=ops):
            for k, op in enumerate(ops):
                for kind in SWAPPED.get(type(op), []):
                    yield changed(ops=[*ops[:k], kind(), *ops[k + 1 :]])
        case ast.UnaryOp(op=op, operand=operand):
            yield operand
            if isinstance(op, ast.Invert):
                yield changed(op=ast.USub())
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield ast.Constant(value + 1)
            yield ast.Constant(value - 1)
        case ast.Constant(value=float(value)):
            yield ast.Constant(value * 1.01 + 0.001)
            yield ast.Constant(value * 0.9 - 0.01)
            if value:
                yield ast.Constant(-value)
        case ast.Constant(value=str(value)) if " " not in value:  # else a docstring
            yield ast.Constant(value + "x")
        case ast.Constant(value=None):
            yield ast.Constant(0)
        case ast.Call(func=func, args=args, keywords=keywords):
            if len(args) >= 2 and getattr(func, "id", "") not in ("min", "max"):
                yield changed(args=[args[1], args[0], *args[2:]])
            for k in range(len(keywords)):
                yield changed(keywords=keywords[:k] + keywords[k + 1 :])
            name = getattr(func, "id", getattr(func, "attr", ""))
            if name in UNWRAPPED and args:
                yield args[0]
            if isinstance(func, ast.Attribute) and len(args) + len(keywords) > 0:
                yield func.value
        case ast.Name(id=name, ctx=ast.Load()) if name in NAMES:
            for other in NAMES[name]:
                yield changed(id=other)
        case ast.Attribute(attr=name, value=value):
            for other in NAMES.get(name, []):
                yield changed(attr=other)
            if name == "T":
                yield value
        case ast.Tuple(elts=elts, ctx=ast.Load()) if len(elts) == 2:
            yield changed(elts=elts[::-1])
        case ast.IfExp(body=body, orelse=orelse):
            yield changed(body=orelse, orelse=body)
            yield body
            yield orelse
        case ast.If(test=test) | ast.While(test=test):
            yield changed(test=ast.UnaryOp(ast.Not(), test))
            yield changed(test=ast.Constant(False))
            if isinstance(node, ast.If):
                yield changed(test=ast.Constant(True))
        case ast.Break():
            yield ast.Continue()
    if isinstance(node, ast.AugAssign | ast.Break) or (
        isinstance(node, ast.Expr) and not isinstance(node.value, ast.Constant)
    ):
        yield ast.Pass()


def _mutations(tree: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """For each fault: a tree with it, and the node that was replaced."""
    for number, node in enumerate(ast.walk(tree)):
        for other in _replacements(node):
            faulty = copy.deepcopy(tree)
            target = list(ast.walk(faulty))[number]

            class Replaced(ast.NodeTransformer):
                def visit(self, one, target=target, other=other):
                    return copy.deepcopy(other) if one is target else self.generic_visit(one)

            yield ast.fix_missing_locations(Replaced().visit(faulty)), node


def code_of(script: Path) -> str:
    """A script without the cell that finds the library, whose magics are not Python."""
    first = r'# %% tags=\["remove-cell"\]\n.*?(?=\n# %%)'
    return re.sub(first, "", script.read_text(encoding="utf-8"), count=1, flags=re.S)


def solutions(script: Path) -> tuple[str, dict[str, str], dict[str, str]]:
    """The code around the solutions, each solved function's code, what each check is handed."""
    text = code_of(script)
    handed = dict(re.findall(r"^checks\.(\w+)\((.+)\)$", text, re.M))
    # A solution outside of any function is run only if it is short: the others search or fly
    text = re.sub(
        r"^### BEGIN SOLUTION\n((?!### END)(.|\n))*?\nfor (.|\n)*?^### END SOLUTION",
        "",
        text,
        flags=re.M,
    )
    around, solved = [], {}
    for statement in ast.parse(text).body:
        code = ast.unparse(statement)
        lines = "\n".join(text.splitlines()[statement.lineno - 1 : statement.end_lineno])
        if isinstance(statement, ast.FunctionDef | ast.ClassDef) and "BEGIN SOLUTION" in lines:
            solved[statement.name] = code
        elif not isinstance(statement, ast.For | ast.Expr):
            around.append(code)
    return "\n".join(around), solved, handed


def solved_in(script: Path) -> dict[str, list[str]]:
    """For each exercise of a script the functions and classes, as code, that are its solution."""
    _, solved, handed = solutions(script)
    found: dict[str, list[str]] = {}
    for name, code in solved.items():
        users = (one for one, given in handed.items() if name in re.findall(r"\w+", given))
        exercise = next(users, None)
        if exercise is not None:
            found.setdefault(exercise, []).append(code)
    return found


def mutants(script: Path, exercise: str) -> Iterator[tuple[str, str]]:
    """What names each fault, "the line -> the faulty line", and the code with it."""
    for code in solved_in(script)[exercise]:
        tree, seen = ast.parse(code), {ast.unparse(ast.parse(code))}
        for faulty, node in _mutations(tree):
            try:
                source = ast.unparse(faulty)
                ast.parse(source)
            except (SyntaxError, ValueError, AttributeError, TypeError):
                continue
            if source in seen:
                continue
            seen.add(source)
            before = code.splitlines()
            differing = [line.strip() for line in source.splitlines() if line not in before]
            line = before[getattr(node, "lineno", 1) - 1].strip()
            yield f"{line} -> {differing[0] if differing else '(removed)'}", source
