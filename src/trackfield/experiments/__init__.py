"""Each paper's tables and figures beside ours."""
