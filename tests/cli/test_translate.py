"""`s2r translate`: fit, list and wrong requests."""


def test_a_translator_of_a_store_is_fitted_and_listed(store_copy, s2r):
    fit = ["translate", "fit", "reinhard", "--direction", "real2sim", "--store", str(store_copy)]
    assert "translator reinhard-real2sim registered" in s2r(*fit).printed
    (row,) = s2r("translate", "list", "--store", store_copy, "--json").json
    assert (row["translator"], row["from"], row["to"]) == ("reinhard-real2sim", "real", "sim")


WRONG_REQUESTS = (
    ("fit vangogh --store STORE", "vangogh"),
    ("fit mkl", "name --store S, or --source"),
    ("fit mkl --source a --out b", "--target"),
    ("fit mkl --store STORE --domains sim", "SIM,REAL"),
    ("fit mkl --store STORE --domains sim,sim", "two different domains"),
    ("fit mkl --store STORE --domains real,sim", "real is a real domain"),
    ("fit mkl --store STORE --paired", "mkl does not use pairs"),
    ("fit mkl --store STORE --option beta=1", "mkl: option 'beta': one of statistics"),
    ("fit mkl --store STORE --size 3", "--size"),
    ("fit mkl --store STORE --name ../x", "../x"),
    ("fit all --store STORE --name x", "--name"),
    ("fit mkl --source /nowhere --target /nowhere --out x.safetensors", "/nowhere"),
    ("apply nothing in out", "--store"),
    ("apply missing.safetensors in out", "missing.safetensors"),
    ("apply missing.safetensors in out --strength 2", "--strength"),
)


def test_wrong_requests_end_in_one_line(tiny_store, tmp_path, monkeypatch, s2r):
    monkeypatch.chdir(tmp_path)
    for request_text, message in WRONG_REQUESTS:
        words = request_text.replace("STORE", str(tiny_store)).split()
        s2r("translate", *words).assert_refused(message)
    assert not list(tmp_path.glob("*.safetensors"))
