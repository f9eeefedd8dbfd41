"""The command line of handbench: the functions of its commands, by what they work on."""
