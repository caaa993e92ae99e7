"""What the paper does not have; each idea is a module that adds itself from outside."""
