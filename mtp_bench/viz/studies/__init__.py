"""A comparison in files: tables, figures, a page and a notebook."""
