"""Still stretches of a recording, and the poses that they are."""
