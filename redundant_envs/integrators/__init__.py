"""Integration methods, error control, events and contacts, on any kind of numbers."""
