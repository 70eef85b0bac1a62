"""What a lane does, as ordinary Python on numbers: dynamics, interval, episode; it knows no compiler."""
