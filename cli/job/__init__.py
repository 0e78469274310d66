"""Parts of a render job: checkpoints, and notes on options without an effect."""
