"""Methods of integration and their error control; they know no robot."""
