CREATE TABLE run (            -- one evolutionary run; its numbers are those of its checkpoint
    id INTEGER PRIMARY KEY,   -- from 1, condition by condition
    name TEXT NOT NULL UNIQUE,
    task TEXT NOT NULL,
    noise REAL NOT NULL,      -- level: 0 zero, 1 observed, 2 double
    position INTEGER NOT NULL, -- from 1 within its condition
    encoding TEXT NOT NULL,   -- JSON: dtype and shape of its genotypes, the encoding's name and settings
    evaluations INTEGER NOT NULL DEFAULT 0,
    best_fitness REAL,        -- highest fitness stored so far, of evaluation `fittest`
    fittest INTEGER,
    champion INTEGER,         -- evaluation number of the best in the retest, once finished
    champion_fitness REAL,    -- its mean score in the retest
    finished INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE checkpoint (     -- what a run goes on from; written with the evaluations before it
    run INTEGER PRIMARY KEY REFERENCES run(id),
    evaluations INTEGER NOT NULL,
    state BLOB NOT NULL
);
CREATE TABLE retest (         -- the last population on fresh trials at the run's own noise
    run INTEGER NOT NULL REFERENCES run(id),
    cell INTEGER NOT NULL,
    number INTEGER NOT NULL,
    trial INTEGER NOT NULL,
    score REAL NOT NULL,
    PRIMARY KEY (run, cell, trial)
) WITHOUT ROWID;
CREATE TABLE test (           -- `who`: fittest or champion; on fresh trials at three noise levels
    run INTEGER NOT NULL REFERENCES run(id),
    who TEXT NOT NULL,
    noise REAL NOT NULL,
    trial INTEGER NOT NULL,
    score REAL NOT NULL,
    PRIMARY KEY (run, who, noise, trial)
) WITHOUT ROWID;
CREATE TABLE session (        -- who has worked on this study, and with which versions
    id INTEGER PRIMARY KEY,
    began TEXT NOT NULL,      -- UTC
    pid INTEGER NOT NULL,
    versions TEXT NOT NULL    -- JSON
);
CREATE TABLE source (         -- all that the study follows from, as it was when it was made
    name TEXT PRIMARY KEY,    -- a file's, from the study's folder
    content BLOB NOT NULL
);
CREATE TABLE task (           -- what a task is, beside its score: nobody has to run its file for that
    name TEXT PRIMARY KEY,
    facts TEXT NOT NULL       -- JSON
);
CREATE TABLE digest (         -- of the rows of a table that belong to a run; run 0: of the whole table
    run INTEGER NOT NULL,
    part TEXT NOT NULL,
    value BLOB NOT NULL,
    PRIMARY KEY (run, part)
) WITHOUT ROWID;

CREATE TABLE evaluation (     -- every individual that was ever evaluated
    run INTEGER NOT NULL REFERENCES run(id),
    number INTEGER NOT NULL,  -- from 0 within its run
    fitness REAL NOT NULL,    -- mean of its trials' scores
    -- SCORES
    parent_a INTEGER NOT NULL, -- evaluation numbers; -1: none
    parent_b INTEGER NOT NULL,
    cell INTEGER NOT NULL,    -- the place in the population that it took, or was offered
    PRIMARY KEY (run, number)
) WITHOUT ROWID;
CREATE TABLE genotypes (      -- of all evaluations, as many to a row as were kept at once
    run INTEGER NOT NULL REFERENCES run(id),
    number INTEGER NOT NULL,  -- of the first of them
    content BLOB NOT NULL,    -- zlib: one after the other, of the dtype and shape in run.encoding
    PRIMARY KEY (run, number)
);
