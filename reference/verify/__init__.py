"""Proof of truths: stored ones against fresh renders, and every route against a second, independent one."""
