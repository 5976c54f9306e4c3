"""What the service keeps: rows in a database, bytes in a storage, and both in a backup."""
