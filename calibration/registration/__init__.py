"""From matched points to `radar_from_photo` with its covariance."""
