"""What several views share: inputs, maps, legends, axes."""
