"""Reports made from result folders: tables, figures and HTML pages, and drawings to print."""
