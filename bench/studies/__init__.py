"""Studies: cases, measured, as tables, figures and pages."""
