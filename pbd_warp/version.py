"""The version, in a file that can be read without importing Warp."""

__version__ = "0.1.0"
