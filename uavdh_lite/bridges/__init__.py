"""Ways to other programs; each needs the optional packages that its errors name."""
