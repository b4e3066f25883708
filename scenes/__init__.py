"""What is in the picture: small parametric scenes, each no bigger than its question."""
