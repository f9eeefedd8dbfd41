"""Common modules of all packages: errors, configuration, files, progress, parallel work, the store
of stages."""
