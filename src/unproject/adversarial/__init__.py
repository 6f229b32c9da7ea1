"""Adversarial training: losses, gradient penalties, augmentation and regularisers."""
