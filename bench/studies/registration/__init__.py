"""Study of the registration of photographs and radar, on simulated captures with known
transforms."""
