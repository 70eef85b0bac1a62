"""The program of a lane, as ordinary Python on numbers: dynamics, interval, episode; it knows no compiler."""
