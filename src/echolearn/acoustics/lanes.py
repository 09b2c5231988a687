"""Several numbers at once in compiled loops: what is done to one is done to all, with its bits.

    x = lanes_at((array, n))        numbers n to n + WIDTH - 1 of a flat array of float32
    s = fused((x, y, s))            s + x y, rounded once

A compiler that sees one number at a time must first prove that loops may be turned inside out, and
keeps sums in memory where it cannot. `wide` lets it use the widest vectors of a processor, which
it shuns unless told.

Who changes this file changes those that import it, too: Numba makes its code anew where the file of
a loop is another, whatever that imports.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

WIDTH = 16
"""Numbers of float32 that are worked on at once."""

VECTOR = ir.VectorType(ir.FloatType(), WIDTH)

WIDEST = ('"prefer-vector-width"="512"', '"min-legal-vector-width"="512"')
"""Attributes by which LLVM uses vectors of 512 bits where a processor has them."""


class Lanes(types.Type):
    """Numbers that are worked on at once; they live in compiled functions alone."""


LANES = Lanes(name="Lanes")


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """Lanes are held as one vector of the processor."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)  # type: ignore[no-untyped-call]


@intrinsic
def wide(_: Any) -> Any:
    """Let the function in which this stands use the widest vectors."""

    def write(builder: Any) -> None:
        """Tell LLVM; llvmlite refuses names that it does not know."""
        set.update(builder.function.attributes, WIDEST)

    return instructions(types.void(), write)


@intrinsic
def no_lanes(_: Any) -> Any:
    """Return lanes that are all 0."""
    return instructions(LANES(), lambda _: ir.Constant(VECTOR, [0.0] * WIDTH))


@intrinsic
def lanes_at(_: Any, place: Any) -> Any:
    """Return the numbers of a place: a flat array of float32, and the index of the first."""
    return instructions(LANES(place), lambda builder, *place: _lanes(builder, *place)[0])


@intrinsic
def parts_at(_: Any, place: Any) -> Any:
    """Return real and imaginary parts of the numbers of a place, in an array of complex64."""

    def write(builder: Any, *place: Any) -> Any:
        """Read twice as many numbers, and take every second of them."""
        halves = _lanes(builder, *place, count=2)
        kind = ir.VectorType(ir.IntType(32), WIDTH)
        every = [ir.Constant(kind, [2 * n + part for n in range(WIDTH)]) for part in range(2)]
        parts = [builder.shuffle_vector(*halves, order) for order in every]
        return cgutils.pack_array(builder, parts)  # type: ignore[no-untyped-call]

    pair = types.UniTuple(LANES, 2)  # type: ignore[no-untyped-call]
    return instructions(pair(place), write)


@intrinsic
def write_lanes(_: Any, written: Any) -> Any:
    """Write lanes: a flat array of float32, the index of the first, and they."""

    def write(builder: Any, *written: Any) -> None:
        """Write them where they belong, wherever that is."""
        builder.store(written[2], _place(builder, *written[:2])).align = 4

    return instructions(types.void(written), write)


@intrinsic
def fused(_: Any, numbers: Any) -> Any:
    """Return a b + c of lanes (a, b, c), rounded once."""
    return instructions(LANES(numbers), _fused)


@intrinsic
def fused_less(_: Any, numbers: Any) -> Any:
    """Return c - a b of lanes (a, b, c), rounded once."""
    return instructions(
        LANES(numbers), lambda builder, a, *others: _fused(builder, builder.fneg(a), *others)
    )


def _fused(builder: Any, *lanes: Any) -> Any:
    kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
    name = f"llvm.fma.v{WIDTH}f32"
    return builder.call(builder.module.declare_intrinsic(name, (), kind), lanes)


def _place(builder: Any, *place: Any) -> Any:
    """Return the address of lanes of an array's data."""
    return builder.bitcast(builder.gep(place[0], [place[1]]), VECTOR.as_pointer())


def _lanes(builder: Any, *place: Any, count: int = 1) -> list[Any]:
    """Return so many lanes that follow each other."""
    first = _place(builder, *place)
    places = [builder.gep(first, [ir.IntType(32)(n)]) for n in range(count)]
    # Arrays of numbers begin where numbers may, not where vectors do.
    return [builder.load(each, align=4) for each in places]


def instructions(kind: Any, write: Callable[..., Any]) -> tuple[Any, Callable[..., Any]]:
    """Return the type of an instruction and what writes it, given the parts of its tuple.

    Of arrays that is the address of their data.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Write the instructions of one call.

        Args:
            context: Numba's way to write instructions.
            builder: place where they are written.
            signature: types of the call.
            arguments: values of the call.
        """
        given = []
        for tuple_kind, value in zip(signature.args, arguments, strict=True):
            parts = cgutils.unpack_tuple(builder, value)  # type: ignore[no-untyped-call]
            for part_kind, part in zip(tuple_kind, parts, strict=True):
                is_array = isinstance(part_kind, types.Array)
                array = context.make_array(part_kind) if is_array else None
                given.append(array(context, builder, part).data if array else part)
        result = write(builder, *given)
        return context.get_dummy_value() if signature.return_type == types.void else result

    return kind, generate
