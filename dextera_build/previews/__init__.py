"""Values as lines of text, pictures and HTML, for notebooks, messages and reports."""
