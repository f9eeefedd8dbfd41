"""Reports: tables, figures and HTML from result folders."""
