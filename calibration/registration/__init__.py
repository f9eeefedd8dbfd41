"""Registration of the photo frame to the radar frame, from matched points: the transform
`radar_from_photo` with its covariance."""
