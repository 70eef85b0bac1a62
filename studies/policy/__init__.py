"""What the physics costs a policy: the same episodes under each, and training under the cheapest."""
