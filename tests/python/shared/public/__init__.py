"""Every public function with a valid call: what to call it with, and what its arguments are."""
