"""The paper of Shim, Tu & Lim (2000): its nine tests, tables, criteria, reproduction and report."""
