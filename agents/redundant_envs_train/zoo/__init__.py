"""rl_zoo3 with the averaged learners and the native vector environment."""
