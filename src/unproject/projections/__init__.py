"""Projections: forward operators, priors over their latents, and observations."""
