"""What a robot runs: a bundle and recordings in, confidences and maps out."""
