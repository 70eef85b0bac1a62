"""The physics dialect: primitives and functions of it, numbers with derivatives, quantities, draws."""
