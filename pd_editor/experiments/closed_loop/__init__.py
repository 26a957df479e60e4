"""Roll-outs: traffic that answers, generated again and again around driven agents."""
