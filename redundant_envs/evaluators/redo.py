"""Lanes that one step does not serve, gathered eight at a time: text, copied where it is needed.

The names it uses without defining them (rows of the memory, compiled lane functions) are those of
the assembled module.
"""

# ---- copied from here ----------------------------------------------------------------------------


@njit(inline="always", **OPTIONS)
def redo(W, S, first, last):
    """Advance the marked ones of the lanes first to last, each with steps of its own.

    A slot of the scratch block S that falls free takes the next marked lane, so no lane waits for
    its neighbours; and since each slot has its own h, none knows of them.
    """
    upcoming = first
    busy = 0
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
        if busy == 0:
            break
        another_piece(S)
        for i in range(LANES):
            if S[i + PHASE] == COMPLETE:
                leave(S, i, W, int(S[i + HOME]) - 1)
                S[i + PHASE] = 0.0
                S[i + HOME] = 0.0
                busy -= 1
