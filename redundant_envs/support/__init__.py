"""Small things without physics: values and files of users, tables, figures, progress."""
