"""What people read: text for the terminal, figures, and the one-file HTML report."""
