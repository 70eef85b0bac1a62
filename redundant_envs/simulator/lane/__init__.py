"""One lane: its dynamics, its step, and how it crosses a control interval; ordinary Python on numbers."""
