"""Tables as Markdown, CSV and LaTeX, and on the terminal."""
