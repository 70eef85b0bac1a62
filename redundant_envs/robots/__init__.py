"""The arms: parameters and equations, no numerics."""
