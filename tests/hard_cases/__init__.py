"""Hard cases: motions whose promises are numbers, and naive variants that miss them."""
