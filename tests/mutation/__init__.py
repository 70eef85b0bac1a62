"""Do the tests see faults: mutants of equations, numerics, events and lanes, and faults that were mended?"""
