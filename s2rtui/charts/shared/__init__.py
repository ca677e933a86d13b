"""Parts that several views share: maps, pictures of an instance, legends, scales, figures."""
