"""Terms against plain arithmetic: whatever a constructor rewrites, its values and its bounds must hold."""

import random
from collections.abc import Callable

import numpy as np
import pytest

from bitneat.prove.evaluation import values_of
from bitneat.prove.queries import SOLVERS, Answer, SolverDisagreementError, differ, queries_by
from bitneat.prove.terms import Atom, Term, Terms, rebuild, signed, substituted
from tests.conftest import BUDGET

SAMPLES = 64
WIDTHS = (1, 8, 16, 32, 64)
Numbers = list[int]


def numbers(term: Term, atoms: dict[Atom, np.ndarray]) -> Numbers:
    return [int(value) for value in np.broadcast_to(values_of([term], atoms)[0], (SAMPLES,))]


def concatenated(terms: Terms, x: Term, a: Numbers, y: Term, b: Numbers) -> tuple[Term, Numbers]:
    return terms.concat([x, y]), [low | high << x.width for low, high in zip(a, b, strict=True)]


def drawn(rng: random.Random, terms: Terms, pool: list[tuple[Term, Numbers]]) -> tuple[Term, Numbers]:
    """One more term of those that are there, and its values by Python's integers."""
    x, a = rng.choice(pool)
    width = x.width
    y, b = rng.choice([one for one in pool if one[0].width == width])
    k = rng.randrange(width)

    def each(of: Callable[..., int], *columns: Numbers) -> Numbers:
        return [of(*row) for row in zip(*columns, strict=True)]

    match rng.randrange(20):
        case 0:
            return terms.add(x, y), each(lambda p, q: p + q, a, b)
        case 1:
            return terms.sub(x, y), each(lambda p, q: p - q, a, b)
        case 2:
            return terms.neg(x), each(lambda p: -p, a)
        case 3:
            return terms.invert(x), each(lambda p: ~p, a)
        case 4:
            factor = rng.choice((2, -1, 3, 4, 256))
            return terms.times(x, factor), each(lambda p: p * factor, a)
        case 5:
            return terms.shl(x, k), each(lambda p: p << k, a)
        case 6:
            return terms.lshr(x, k), each(lambda p: p >> k, a)
        case 7:
            return terms.ashr(x, k), each(lambda p: signed(p, width) >> k, a)
        case 8 | 9:
            size = rng.randint(1, width - k)
            return terms.extract(x, k, size), each(lambda p: p >> k, a)
        case 10:
            return terms.zext(x, rng.choice([w for w in WIDTHS if w >= width])), a
        case 11:
            return terms.sext(x, rng.choice([w for w in WIDTHS if w >= width])), each(lambda p: signed(p, width), a)
        case 12:
            other, c = rng.choice(pool)
            return concatenated(terms, x, a, other, c) if width + other.width <= 64 else (x, a)
        case 13:
            return terms.bit_and(x, y), each(lambda p, q: p & q, a, b)
        case 14:
            return terms.bit_or(x, y), each(lambda p, q: p | q, a, b)
        case 15:
            return terms.bit_xor(x, y), each(lambda p, q: p ^ q, a, b)
        case 16:
            condition, c = rng.choice([one for one in pool if one[0].width == 1])
            return terms.ite(condition, x, y), each(lambda s, p, q: p if s else q, c, a, b)
        case 17:
            mask = rng.choice(((1 << k) - 1, ((1 << k) - 1) << rng.randrange(width), rng.getrandbits(width)))
            return terms.bit_and(x, terms.const(width, mask)), each(lambda p: p & mask, a)
        case 18:
            less = rng.choice((True, False))
            if less:
                return terms.slt(x, y), each(lambda p, q: signed(p, width) < signed(q, width), a, b)
            return terms.ult(x, y), each(lambda p, q: p < q, a, b)
        case _:
            return terms.eq(x, y), each(lambda p, q: p == q, a, b)


@pytest.mark.parametrize("block", range(4))
def test_a_term_has_the_values_that_arithmetic_gives(block: int) -> None:
    for seed in range(1000 * block, 1000 * block + 100 * BUDGET):
        rng = random.Random(seed)
        terms, atoms, pool = Terms(), {}, []
        for i in range(4):
            limit = rng.choice((1, 3, 255, 256, 1000, 32767))
            low = -limit if rng.random() < 0.7 else 0
            atom = Atom(f"a{i}", low, limit)
            values = [rng.choice((low, limit, rng.randint(low, limit))) for _ in range(SAMPLES)]
            atoms[atom] = np.array(values, dtype=np.int64)
            for width in WIDTHS[1:]:
                if limit < 1 << (width - 1):
                    pool.append((terms.var(atom, width), [value & ((1 << width) - 1) for value in values]))
        for width in WIDTHS:
            for value in (0, 1, -1, rng.getrandbits(width), 1 << (width - 1)):
                pool.append((terms.const(width, value), [value & ((1 << width) - 1)] * SAMPLES))
        for step in range(60):
            term, wanted = drawn(rng, terms, pool)
            wanted = [int(value) & ((1 << term.width) - 1) for value in wanted]
            where = f"seed {seed}, step {step}: {term}"
            assert numbers(term, atoms) == wanted, where
            assert all(term.low <= signed(value, term.width) <= term.high for value in wanted), where
            assert numbers(rebuild(terms, term, term.args), atoms) == wanted, where
            pool.append((term, wanted))


def test_sums_have_one_normal_form_however_they_are_added() -> None:
    terms = Terms()
    x, y, z = (terms.var(Atom(name, -1000, 1000), 32) for name in "xyz")
    assert terms.sub(terms.add(x, y, z), y) is terms.add(z, x)
    narrow = terms.add(*(terms.extract(one, 0, 16) for one in (x, y, z)))
    assert terms.sext(narrow, 32) is terms.add(x, y, z)


@pytest.mark.parametrize("below", [True, False])
def test_a_magnitude_by_a_mask_or_by_its_complement_is_one_choice(below: bool) -> None:
    terms = Terms()
    x = terms.var(Atom("x", -9, 9), 32)
    negative = terms.extract(x, 31, 1)
    mask = terms.sext(negative if below else terms.invert(negative), 32)
    plus, minus = (terms.neg(x), x) if below else (x, terms.neg(x))
    assert terms.sub(terms.bit_xor(x, mask), mask) is terms.ite(negative, plus, minus)
    others = terms.var(Atom("others", -9, 9), 32)
    early = terms.sub(terms.add(others, terms.bit_xor(x, mask)), mask)
    assert early is terms.add(others, terms.ite(negative, plus, minus))


def test_a_mask_and_its_complement_make_a_constant_in_any_sum() -> None:
    terms = Terms()
    bit = terms.extract(terms.var(Atom("x", -9, 9), 32), 31, 1)
    mask, complement = terms.sext(bit, 32), terms.sext(terms.invert(bit), 32)
    assert terms.add(mask, complement) is terms.const(32, -1)
    other = terms.var(Atom("other", 0, 5), 32)
    assert terms.add(mask, other, complement) is terms.add(other, terms.const(32, -1))
    assert terms.sub(terms.const(32, -1), mask) is complement


def test_bits_of_vectors_are_taken_lane_by_lane() -> None:
    terms = Terms()
    lanes = [terms.var(Atom(name, -9, 9), width) for name, width in (("x", 8), ("y", 32), ("z", 8))]
    masks = [terms.sext(terms.extract(lanes[1 - i], 7, 1), one.width) for i, one in enumerate(lanes)]
    vector, mask = terms.concat(lanes), terms.concat(masks)
    for operation in (terms.bit_and, terms.bit_or, terms.bit_xor):
        both, at = operation(vector, mask), 0
        for lane, own in zip(lanes, masks, strict=True):
            assert terms.extract(both, at, lane.width) is operation(lane, own)
            at += lane.width


@pytest.mark.parametrize("complement", [False, True])
def test_a_choice_by_the_sign_of_a_difference_is_a_minimum_or_a_maximum(complement: bool) -> None:
    terms = Terms()
    x, y = terms.var(Atom("x", -9, 5), 32), terms.var(Atom("y", -3, 30), 32)
    less = terms.extract(terms.sub(x, y), 31, 1)  # x < y
    if complement:
        less = terms.invert(terms.extract(terms.sub(y, x), 31, 1))  # not y < x
    smaller, larger = terms.ite(less, x, y), terms.ite(less, y, x)
    assert (smaller.low, smaller.high) == (-9, 5)
    assert (larger.low, larger.high) == (-3, 30)


@pytest.mark.parametrize("changed", [0, 1])
def test_a_term_of_which_one_part_is_another_is_another(changed: int) -> None:
    terms = Terms()
    atoms = [Atom(name, -9, 9) for name in "xyz"]
    x, y, z = (terms.var(atom, 32) for atom in atoms)
    negative = terms.extract(terms.var(Atom("w", -9, 9), 32), 31, 1)
    for make in (lambda a, b: terms.ite(negative, a, b), terms.mul, terms.bit_and, lambda a, b: terms.concat([a, b])):
        before = make(x, y)
        (after,) = substituted(terms, [before], {atoms[changed]: z})
        assert after is (make(z, y) if changed == 0 else make(x, z))
        assert rebuild(terms, before, before.args) is before


def test_a_sum_that_may_wrap_is_not_taken_for_one_that_does_not() -> None:
    terms = Terms()
    x, y = (terms.var(Atom(name, -20000, 20000), 32) for name in "xy")
    narrow = terms.add(terms.extract(x, 0, 16), terms.extract(y, 0, 16))
    assert terms.sext(narrow, 32) is not terms.add(x, y)


def test_an_atom_gives_way_to_a_term_of_any_width() -> None:
    terms = Terms()
    atom, other = Atom("x", -300, 300), Atom("y", -100, 100)
    double = terms.times(terms.var(other, 32), 2)
    (found,) = substituted(terms, [terms.add(terms.var(atom, 16), terms.const(16, 5))], {atom: double})
    assert found is terms.add(terms.times(terms.var(other, 16), 2), terms.const(16, 5))


def minimum_by_mask(terms: Terms, x: Term, y: Term) -> Term:
    difference = terms.sub(x, y)
    return terms.add(y, terms.bit_and(difference, terms.ashr(difference, 31)))


@pytest.mark.parametrize("paranoid", [False, True])
def test_solvers_tell_equal_from_different(paranoid: bool) -> None:
    terms = Terms()
    a, b = Atom("a", -32767, 32767), Atom("b", -32767, 32767)
    x, y = terms.var(a, 32), terms.var(b, 32)
    least = terms.ite(terms.slt(x, y), x, y)
    assert differ(minimum_by_mask(terms, x, y), least, seconds=20, paranoid=paranoid).outcome == "equal"
    most = terms.ite(terms.slt(x, y), y, x)
    answer = differ(least, most, seconds=20, paranoid=paranoid)
    assert answer.outcome == "differ"
    assert answer.model is not None
    assert answer.model[a] != answer.model[b]


def test_bounds_of_atoms_reach_the_solver() -> None:
    terms = Terms()
    x = terms.var(Atom("x", -5, 300), 32)
    bits = terms.bit_and(terms.add(x, terms.const(32, 5)), terms.const(32, 0x155))
    assert differ(bits, terms.const(32, 0x400), seconds=20).outcome == "differ"
    beyond = terms.eq(terms.bit_xor(x, terms.const(32, 1)), terms.const(32, 302))
    assert differ(beyond, terms.const(1, 0), seconds=20).outcome == "equal"


def test_solvers_that_contradict_each_other_are_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(queries_by, SOLVERS[1], lambda text, names, seconds: Answer("equal"))
    terms = Terms()
    x, y = (terms.var(Atom(name, -9, 9), 32) for name in "xy")
    with pytest.raises(SolverDisagreementError, match="disagree"):
        differ(terms.bit_xor(x, y), terms.bit_or(x, y), seconds=20, paranoid=True)
