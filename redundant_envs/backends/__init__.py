"""What turns graphs, or ordinary Python, into results: one module for each kind of numbers or machine."""
