"""Tables as Markdown, CSV, LaTeX and on the terminal."""
