"""Records of arrays that the kernels of the association hand to each other; README.md explains the words."""

from typing import NamedTuple

from ...core import Bools, Floats, Ints


class Problem(NamedTuple):
    """Assignment problem of the allowed pairs, split into components; each numbers its columns from 0."""

    rows: Ints  # [A] the caller's rows that have a pair
    start: Ints  # [C + 1] where the rows of each component begin
    width: Ints  # [C] columns of each component
    first: Ints  # [A + 1] where the pairs of each row begin
    column: Ints  # [E] column of each pair in its component
    cost: Floats  # [E]
    column_of_caller: Ints  # [E]


class Pieces(NamedTuple):
    """Distinct subsets of the rows of a component that parents hold."""

    component: Ints  # [Q]
    begin: Ints  # [Q + 1] where the rows of each piece begin in ``places``
    places: Ints  # rows of the pieces, as indices into `Problem.rows`
    of_parent: Ints  # [P, C] the piece of each parent and component, -1 where the parent has no row of it


class Solutions(NamedTuple):
    """The solutions of all pieces, the cheapest of each piece first."""

    begin: Ints  # [Q] number of the first solution of each piece
    size: Ints  # [Q] how many it has
    gap: Floats  # by solution: how much dearer than the first of its piece
    pair_at: Ints  # by solution: where its pairs begin in ``pairs``
    pairs: Ints  # the pair of each row of the piece, -1: unmatched


class Block(NamedTuple):
    """The pairs of one piece; its rows and columns are numbered from 0."""

    n: int  # rows
    m: int  # columns
    first: Ints  # [n] first pair of each row
    last: Ints  # [n] the one after its last
    column: Ints  # [E] of each pair
    cost: Floats  # [E]
    banned: Bools  # [E] pairs that Murty's search forbids at the moment


class Matching(NamedTuple):
    """Matching of the rows and columns of a piece, with its dual potentials."""

    match: Ints  # [n] pair of each row, -1: unmatched
    owner: Ints  # [m] row of each column, -1: unmatched
    u: Floats  # [n] potentials of rows
    v: Floats  # [m] of columns
    row_out: Bools  # [n] rows that take no part
    column_out: Bools  # [m] columns that take no part


class Path(NamedTuple):
    """Columns that a search for the shortest alternating path has reached."""

    dist: Floats  # [m] infinite between searches
    through: Ints  # [m] the pair by which a column was reached, -1: from the hub
    by: Ints  # [m] the row, -1: the hub
    seen: Ints  # [m] the columns reached, those that are closed first
    hub: Ints  # [3] row and column that the hub was reached from, -1: none; number of columns seen


class Choices(NamedTuple):
    """The partial choice of an enumeration."""

    taken: Bools  # [m] columns
    option: Ints  # [n] pair of each row so far; `Block.last` stands for unmatched
    lower: Floats  # [n + 1] lower bound of the rise over the cheapest solution, after each row
    total: Floats  # [n + 1] cost so far


class Kept(NamedTuple):
    """The at most k best solutions of a piece so far."""

    order: Ints  # [k] their numbers, cheapest first
    cost: Floats  # [k] by number
    pairs: Ints  # n pairs of each, the first from number ``at`` on
    at: int


class Bound(NamedTuple):
    """The k least totals known of the whole problem: a dearer solution of a piece cannot matter."""

    best: Floats  # [k] increasing
    totals: (
        Floats  # total of the cheapest solution of each parent of the piece, increasing
    )
    size: int  # how many those are
    slack: float  # for rounding


class States(NamedTuple):
    """Changes of cheapest solutions: a state changes one piece more than the state under it."""

    parent: Ints
    piece: Ints  # that it changes, -1: none; during the merge its number in the order of the parent's pieces
    rank: Ints  # of the solution that the piece takes; 0: the state changes nothing
    under: Ints  # -1: none
