"""Lanes that one step does not serve, gathered eight at a time: text, copied where it is needed.

The names it uses without defining them (rows of the memory, compiled lane functions) are those of
the assembled module.
"""

# ---- copied from here ----------------------------------------------------------------------------


@njit(inline="always", **OPTIONS)
def redo(W, S, first, last, finish):
    """Advance the marked ones of the lanes first to last, each with steps of its own.

    A slot of the scratch block S that falls free takes the next marked lane, so no lane waits for
    its neighbours; and since each slot has its own h, none knows of them. Unless all are to
    ``finish``, lanes that are left when a slot stays free go on with the next call.
    """
    upcoming = first
    busy = 0
    for i in range(LANES):
        busy += S[i + HOME] > 0.0
    while True:
        for i in range(LANES):
            while S[i + HOME] == 0.0 and upcoming < last:
                w = upcoming // LANES * STRIDE + upcoming % LANES
                upcoming += 1
                if W[w + MARKED] > 0.0:
                    enter(W, w, S, i)
                    S[i + NEWLY] = 1.0
                    S[i + HOME] = w + 1.0  # where the lane in the slot lives in W, plus 1
                    busy += 1
        if busy == 0 or (busy < LANES and not finish):
            break
        another_piece(S)
        for i in range(LANES):
            if S[i + PHASE] == COMPLETE:
                leave(S, i, W, int(S[i + HOME]) - 1)
                S[i + PHASE] = 0.0
                S[i + HOME] = 0.0
                busy -= 1


@njit(inline="always", **OPTIONS)
def absent(S, o):
    """Whether a lane of the block at o is in the scratch block."""
    away = False
    for i in range(LANES):
        away |= o < S[i + HOME] <= o + LANES
    return away


@njit(inline="always", **OPTIONS)
def served(W, o):
    """The marks of a block whose lanes are all complete are taken away."""
    for i in range(LANES):
        W[o + i + MARKED] = 0.0


@njit(inline="always", **OPTIONS)
def first_absent(S, end):
    """The first block that has a lane in the scratch block, else ``end``."""
    for i in range(LANES):
        if S[i + HOME] > 0.0:
            end = min(end, (int(S[i + HOME]) - 1) // STRIDE)
    return end
