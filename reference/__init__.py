"""The truth: Mitsuba renders, closed forms and brute force in float64, and the store of truths."""
