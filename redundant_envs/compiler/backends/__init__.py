"""Back ends that turn graphs, or ordinary Python, into results: one module per kind of number or machine."""
