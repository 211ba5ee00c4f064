"""The paper's field trials and claims, reproduced."""
