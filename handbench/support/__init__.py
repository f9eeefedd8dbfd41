"""Modules that all packages use: errors, configuration, files, progress, parallel work, and the
store of finished stages."""
