"""Readers of what a path holds: pictures, arrays, 3-D collections, textures, photographs, light probes."""
