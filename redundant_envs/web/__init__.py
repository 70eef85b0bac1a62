"""Simulators for JavaScript: modules of WebAssembly, and what drives them."""
