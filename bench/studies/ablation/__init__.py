"""Study of `effects = "auto"`, the automatic selection of simulated effects, on scenes of all
kinds."""
