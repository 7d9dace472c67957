"""Where sensors stand and what they are: the site."""
