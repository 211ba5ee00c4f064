"""scikit-learn and GPyTorch on the data of `gp.py`: run by it with the Python of `.venv-bench`, one line of JSON out.

Usage: python gp_rivals.py DATA.npz

DATA.npz: places (n, 2), depths (n,), queries (P, 2), new (m, 2), new_depths (m,), signal_std, length, noise_std, mean;
for the fit also fit_places (k, 2), fit_depths (k,).
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np

#: Places asked for at once; a whole map at once takes several times the memory of n x P doubles.
CHUNK = 2048


def scikit_learn(data: Any) -> dict[str, Any]:
    """Map (at once and in chunks: the faster counts) and fit."""
    import sklearn
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    kernel = ConstantKernel(float(data["signal_std"]) ** 2) * Matern(float(data["length"]), nu=2.5)
    model = GaussianProcessRegressor(kernel, alpha=float(data["noise_std"]) ** 2, optimizer=None)
    model.fit(data["places"], data["depths"] - float(data["mean"]))
    queries = data["queries"]
    begin = time.perf_counter()
    parts = [model.predict(queries[i : i + CHUNK], return_std=True) for i in range(0, len(queries), CHUNK)]
    chunked = time.perf_counter() - begin
    begin = time.perf_counter()
    model.predict(queries, return_std=True)
    at_once = time.perf_counter() - begin
    result: dict[str, Any] = {
        "version": sklearn.__version__,
        "map_s": min(chunked, at_once),
        "mean_sum": float(sum(m.sum() for m, _ in parts) + len(queries) * float(data["mean"])),
        "std_sum": float(sum(s.sum() for _, s in parts)),
    }
    if "fit_places" in data:
        free = ConstantKernel(50.0, (1e-2, 1e5)) * Matern(100.0, (1.0, 1e5), nu=2.5) + WhiteKernel(0.1, (1e-6, 1e3))
        depths = data["fit_depths"] - data["fit_depths"].mean()
        begin = time.perf_counter()
        fitted = GaussianProcessRegressor(free, n_restarts_optimizer=4, random_state=0).fit(data["fit_places"], depths)
        result["fit_s"] = time.perf_counter() - begin
        result["fit_log_likelihood"] = float(fitted.log_marginal_likelihood_value_)
    return result


def gpytorch(data: Any) -> dict[str, Any]:
    """Map (exact with and without fast_pred_var) and appending one datum."""
    import gpytorch
    import torch

    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)

    class Exact(gpytorch.models.ExactGP):
        def __init__(self, x: Any, y: Any, likelihood: Any) -> None:
            super().__init__(x, y, likelihood)
            self.mean_module = gpytorch.means.ConstantMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.MaternKernel(nu=2.5))

        def forward(self, x: Any) -> Any:
            return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    x, y, queries = (torch.tensor(data[name]) for name in ("places", "depths", "queries"))

    def model() -> Any:
        likelihood = gpytorch.likelihoods.GaussianLikelihood()
        made = Exact(x, y, likelihood)
        likelihood.noise = float(data["noise_std"]) ** 2
        made.mean_module.constant.data.fill_(float(data["mean"]))
        made.covar_module.outputscale = float(data["signal_std"]) ** 2
        made.covar_module.base_kernel.lengthscale = float(data["length"])
        made.eval()
        likelihood.eval()
        return made

    result: dict[str, Any] = {"version": f"{gpytorch.__version__}, torch {torch.__version__}"}
    # Cholesky throughout: from 800 data on GPyTorch would use conjugate gradients, which are not exact.
    for name, fast in (("exact_map_s", False), ("fast_map_s", True)):
        with (
            torch.no_grad(),
            gpytorch.settings.fast_pred_var(fast),
            gpytorch.settings.max_cholesky_size(100_000),
        ):
            made = model()
            made(queries[:10])  # makes and keeps what depends on the data alone, as a running node would have
            begin = time.perf_counter()
            parts = []
            for part in queries.split(CHUNK):
                prediction = made(part)
                parts.append((prediction.mean, prediction.variance.clamp_min(0).sqrt()))
            result[name] = time.perf_counter() - begin
            if not fast:
                result["mean_sum"] = float(sum(m.sum() for m, _ in parts))
                result["std_sum"] = float(sum(s.sum() for _, s in parts))
    with torch.no_grad(), gpytorch.settings.fast_pred_var(), gpytorch.settings.max_cholesky_size(100_000):
        made = model()
        made(queries[:10])
        begin = time.perf_counter()
        for place, depth in zip(data["new"], data["new_depths"], strict=True):
            made = made.get_fantasy_model(torch.tensor(place[None]), torch.tensor([depth]))
        result["append_s"] = (time.perf_counter() - begin) / len(data["new"])
    return result


def main() -> None:
    """Measures each library that is installed."""
    data = dict(np.load(sys.argv[1]))
    results: dict[str, Any] = {}
    for name, measure in (("scikit-learn", scikit_learn), ("GPyTorch", gpytorch)):
        try:
            results[name] = measure(data)
        except ImportError as error:
            results[name] = {"missing": str(error)}
    print(json.dumps(results))


if __name__ == "__main__":
    main()
