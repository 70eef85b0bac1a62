"""Parts of tasks: no module here is a task of its own."""
