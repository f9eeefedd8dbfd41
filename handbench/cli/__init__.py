"""The command line of handbench: one module for each command."""
