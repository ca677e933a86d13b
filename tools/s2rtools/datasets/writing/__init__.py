"""Write a scan as a store: frames, source images, index rows and the journal of what is done."""
