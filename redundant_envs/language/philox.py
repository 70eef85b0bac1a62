"""Philox4x32-10: random words from a key and a counter, on any whole numbers."""

from typing import Any

ROUNDS = 10
LOW = 0xFFFFFFFF
"""The bits of a word."""


def philox(key: list[Any], counter: list[Any]) -> list[Any]:
    """Four 32-bit words from two of a key and four of a counter (Salmon et al., SC11)."""
    (k0, k1), (c0, c1, c2, c3) = key, counter
    zero = k0 & 0
    c0, c1 = zero + c0, zero + c1
    for _ in range(ROUNDS):
        a = c0 * 0xD2511F53
        b = c2 * 0xCD9E8D57
        c0, c1, c2, c3 = (b >> 32) ^ c1 ^ k0, b & LOW, (a >> 32) ^ c3 ^ k1, a & LOW
        k0, k1 = (k0 + 0x9E3779B9) & LOW, (k1 + 0xBB67AE85) & LOW
    return [c0, c1, c2, c3]
