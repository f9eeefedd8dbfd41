"""Problems of inputs, found before hours are spent."""
