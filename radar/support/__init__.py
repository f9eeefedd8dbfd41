"""What every package stands on: errors, configuration, files, progress, parallel work, the store of stages."""
