"""Mutants of a package: places at which cosmic-ray's operators change the code by a little, and
random ones of these.

Left out: type hints, decorators, error messages (all of `raise` and of f-strings), progress
messages, code that only a GPU runs, and numbers above 10⁴, which cosmic-ray changes by
one. Strings have no operators.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import parso
from cosmic_ray.ast import ast_nodes
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider

BINARY = (
    "Add_Sub Sub_Add Mul_Div Div_Mul FloorDiv_Div Mod_Mul Pow_Mul BitAnd_BitOr BitOr_BitAnd "
    "BitXor_BitOr"
)
SHIFTS = "LShift_RShift RShift_LShift"
COMPARED = (
    "Eq_NotEq NotEq_Eq Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Is_IsNot IsNot_Is"
)
UNARY = "Delete_USub Delete_Not Delete_Invert"
OPERATORS = (
    *(f"ReplaceBinaryOperator_{pair}" for pair in f"{BINARY} {SHIFTS}".split()),
    *(f"ReplaceComparisonOperator_{pair}" for pair in COMPARED.split()),
    *(f"ReplaceUnaryOperator_{pair}" for pair in UNARY.split()),
    "AddNot", "ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue", "NumberReplacer",
    "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ZeroIterationForLoop",
)  # fmt: skip
LEFT_OUT = {
    "raise_stmt",
    "fstring",
    "decorator",
    "decorators",
    "assert_stmt",
    "import_from",
    "import_name",
}
SAYING = {"say", "print", "warn", "track"}
LARGEST = 1e4


@dataclass(frozen=True)
class Mutant:
    """One change of one file. name: file:line:column operator, by which a file of explanations
    knows it."""

    file: str
    line: int
    column: int
    operator: str
    occurrence: int
    kernel: bool  # compiled by numba: coverage does not see it

    @property
    def name(self) -> str:
        """It in words."""
        return f"{self.file}:{self.line}:{self.column} {self.operator}"

    def code(self, root: Path) -> str:
        """The file's text with the change."""
        source = (root / self.file).read_text(encoding="utf-8")
        changed = mutate_code(source, _operators()[self.operator], self.occurrence)
        if changed is None or changed == source:
            raise ValueError(f"{self.name}: changes nothing")
        return changed


def mutants(root: Path, package: str, count: int, seed: int) -> list[Mutant]:
    """`count` mutants of a package: places are drawn first, uniformly, then one of the operators
    that apply there."""
    places: defaultdict[tuple[str, int, int], list[Mutant]] = defaultdict(list)
    for path in sorted((root / package).rglob("*.py")):
        file = path.relative_to(root).as_posix()
        if "/gpu/" in file or "cuda" in file or "gpu" in path.name:
            continue
        for mutant in of_file(root, file):
            places[mutant.file, mutant.line, mutant.column].append(mutant)
    generator, order = random.Random(f"{package} {seed}"), sorted(places)
    generator.shuffle(order)  # so that a larger sample begins with the smaller
    return [random.Random(f"{place} {seed}").choice(places[place]) for place in order[:count]]


def of_file(root: Path, file: str) -> Iterator[Mutant]:
    """All mutants of a file."""
    tree = parso.parse((root / file).read_text(encoding="utf-8"))
    operators = _operators()
    occurrences: defaultdict[str, int] = defaultdict(int)
    for node in ast_nodes(tree):
        left_out = None
        for name, operator in operators.items():
            for start, _ in operator.mutation_positions(node):
                number = occurrences[name]
                occurrences[name] += 1
                if left_out is None:
                    left_out = _left_out(node)
                if not left_out and not (
                    node.type == "number" and abs(complex(_value(node))) > LARGEST
                ):
                    yield Mutant(file, *start, name, number, _kernel(node))


def _value(node: parso.tree.Leaf) -> complex:
    return (
        complex(int(node.value, 0))
        if node.value[:2].lower() in ("0x", "0b", "0o")
        else complex(node.value.replace("_", ""))
    )


def _left_out(node: parso.tree.NodeOrLeaf) -> bool:
    """True in what is not mutated; see the head."""
    inner = node
    while (outer := inner.parent) is not None:
        if outer.type in LEFT_OUT or inner.type in LEFT_OUT:
            return True
        if outer.type == "annassign" and inner is outer.children[1]:
            return True
        if outer.type == "tfpdef" and inner is not outer.children[0]:
            return True
        if outer.type == "funcdef" and outer.annotation is inner:
            return True
        if (
            outer.type in ("atom_expr", "power")
            and getattr(outer.children[0], "value", "") in SAYING
        ):
            return True
        if outer.type == "if_stmt" and outer.children[1].get_code().strip() == "TYPE_CHECKING":
            return True
        inner = outer
    return False


def _kernel(node: parso.tree.NodeOrLeaf) -> bool:
    while node is not None:
        if node.type == "decorated" and any(
            word in node.children[0].get_code() for word in ("jit", "vectorize")
        ):
            return True
        node = node.parent
    return False


def _operators() -> dict[str, Operator]:
    provider = OperatorProvider()
    return {name: provider[name]() for name in OPERATORS}
