"""From takes to rows: rules, cases, loops, variants, baselines and a check of two references."""
