"""Programs from ordinary Python: run once on traced numbers, recorded, transformed by named passes."""
