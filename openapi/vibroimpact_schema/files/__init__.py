"""Matrices in files of other programs: their readers, which client and service share.

Files are bytes with a name, whose ending tells the format. No reader takes memory for what a file
only claims, opens another file, or runs what is in one. The readers need scipy.
"""
