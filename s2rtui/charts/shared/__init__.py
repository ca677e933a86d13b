"""Parts that several views share: maps, images of an instance, legends, scales, figures."""
