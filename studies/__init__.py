"""Our measurements of the library and of policies: ``python -m studies NAME``, in the source tree only."""
