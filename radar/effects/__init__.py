"""Effects that change echoes, one file each."""
