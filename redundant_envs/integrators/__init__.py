"""Integration methods: data and the text of one step."""
