"""What an arm is asked to do: dialect text, compiled into the step."""
