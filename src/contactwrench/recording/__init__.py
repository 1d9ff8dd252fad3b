"""Recordings to Samples and Streams and back, the format chosen by the file's suffix."""
